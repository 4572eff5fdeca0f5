"""The watched process: plans, errors, and what happens when it dies, hangs or is closed."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError
from gpis_grasp_planner.geometry.catalogue import default_catalogue_directory
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.ros.parameter_groups import parameter_groups
from gpis_grasp_planner.ros.worker.messages import PlaceOrder, Plan, PlanOrder
from gpis_grasp_planner.ros.worker.watch import PlanningProcess

VALUES = {name: kind().as_dict() for name, kind in parameter_groups().items() if name}


def order(mesh_id: str = "sphere", time_budget_s: float = 1.0) -> PlanOrder:
    request = PlanRequest(planner="hpp", time_budget_s=time_budget_s, n_grasps=2)
    return PlanOrder(mesh_id, (str(default_catalogue_directory()),), request, VALUES)


class Call(threading.Thread):
    """A plan in a thread of its own, and how it ended."""

    def __init__(self, process: PlanningProcess, task: PlanOrder, grace_s: float = 60.0) -> None:
        super().__init__()
        self.result: Plan | GraspPlannerError | None = None
        self.planning = threading.Event()
        self._task: tuple[Any, ...] = (process, task, grace_s)
        self.start()

    def run(self) -> None:
        process, task, grace_s = self._task
        try:
            self.result = process.plan(task, grace_s, lambda _progress: self.planning.set())
        except GraspPlannerError as error:
            self.result = error

    def wait_planning(self) -> None:
        assert self.planning.wait(90.0)

    def code(self) -> ErrorCode:
        self.join(90.0)
        assert self.result is not None
        return self.result.code


@pytest.fixture(scope="module")
def process() -> Iterator[PlanningProcess]:
    made = PlanningProcess()
    yield made
    made.close()


def test_a_plan_comes_back(process: PlanningProcess) -> None:
    plan = process.plan(order(), grace_s=60.0)
    assert plan.code == ErrorCode.SUCCESS
    assert 1 <= len(plan.grasps) <= 2
    assert plan.grasps[0].epsilon > 0.0
    assert len(plan.mesh_hash) == 64
    assert process.ready


def test_the_planners_errors_keep_code_and_message(process: PlanningProcess) -> None:
    pid = process.pid
    with pytest.raises(GraspPlannerError, match=r"'spere' is unknown.*sphere") as caught:
        process.plan(order("spere"), grace_s=60.0)
    assert caught.value.code == ErrorCode.UNKNOWN_MESH
    assert process.pid == pid


def test_an_unexpected_error_is_an_answer_too(process: PlanningProcess) -> None:
    broken = PlanOrder("sphere", (), PlanRequest(), {})
    with pytest.raises(GraspPlannerError) as caught:
        process.plan(broken, grace_s=60.0)
    assert caught.value.code == ErrorCode.INTERNAL
    assert "KeyError" in caught.value.message


REQUEST = PlanRequest(planner="hpp", n_grasps=1)


def place_order(plan: Plan) -> PlaceOrder:
    """A sphere on a table."""
    place = {"support": {"point": [0.0, 0.0, -0.05]}}
    return PlaceOrder(plan, (str(default_catalogue_directory()),), place, REQUEST, VALUES)


def test_a_plan_is_placed_while_another_is_made(process: PlanningProcess) -> None:
    plan = process.plan(order(), grace_s=60.0)
    running = Call(process, order(time_budget_s=6.0))
    running.wait_planning()
    answers = [process.place(place_order(plan), 60.0) for _ in range(2)]
    assert running.is_alive()
    for placed in answers:
        assert placed.code in (ErrorCode.SUCCESS, ErrorCode.ALL_GRASPS_BLOCKED)
        assert placed.record == b""
        assert len(placed.grasps) <= 1
    assert running.code() == ErrorCode.SUCCESS


def test_errors_of_placing_are_answered_and_do_not_end_the_process(
    process: PlanningProcess,
) -> None:
    plan = process.plan(order(), grace_s=60.0)
    pid = process.pid
    refused: tuple[tuple[dict[str, Any], ErrorCode], ...] = (
        ({"place": {"table": 1}}, ErrorCode.INVALID_SCENE),
        ({"place": {"covariance": [-1.0] * 6}}, ErrorCode.INVALID_COVARIANCE),
        ({"plan": replace(plan, mesh_hash="0" * 64, record=b"other")}, ErrorCode.MESH_UNREADABLE),
        ({"settings": {}}, ErrorCode.INTERNAL),
    )
    for changes, code in refused:
        with pytest.raises(GraspPlannerError) as caught:
            process.place(replace(place_order(plan), **changes), 60.0)
        assert caught.value.code == code
    assert process.pid == pid


def test_a_plan_is_placed_by_the_next_process(process: PlanningProcess) -> None:
    """Stopped before it takes the order; nothing that it knew is needed by the next one."""
    plan = process.plan(order(), grace_s=60.0)
    before = process.place(place_order(plan), 60.0)
    stopped = process.pid
    assert stopped is not None
    os.kill(stopped, signal.SIGSTOP)
    after = process.place(place_order(plan), 60.0)
    assert process.pid not in (None, stopped)
    assert after.code == before.code
    for one, other in zip(before.grasps, after.grasps, strict=True):
        assert np.array_equal(one.T_object_palm, other.T_object_palm)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV])
def test_a_death_is_answered_and_the_next_plan_made(
    process: PlanningProcess, number: signal.Signals
) -> None:
    call = Call(process, order(time_budget_s=30.0))
    call.wait_planning()
    dead = process.pid
    assert dead is not None
    os.kill(dead, number)
    assert call.code() == ErrorCode.PLANNING_PROCESS_LOST
    assert number.name in str(call.result)
    assert process.pid not in (None, dead)
    assert process.plan(order(), grace_s=60.0).code == ErrorCode.SUCCESS


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_loss_while_idle_is_no_matter(process: PlanningProcess, number: signal.Signals) -> None:
    process.ensure_started()
    dead = process.pid
    assert dead is not None
    os.kill(dead, number)
    assert process.plan(order(), grace_s=60.0).code == ErrorCode.SUCCESS
    assert process.pid != dead


def test_a_stopped_process_is_given_up_at_the_deadline(process: PlanningProcess) -> None:
    call = Call(process, order(time_budget_s=1.0), grace_s=3.0)
    call.wait_planning()
    stopped = process.pid
    assert stopped is not None
    os.kill(stopped, signal.SIGSTOP)
    assert call.code() == ErrorCode.DEADLINE_EXCEEDED
    assert "1 s" in str(call.result)
    assert "3 s" in str(call.result)
    with pytest.raises(ProcessLookupError):
        os.kill(stopped, 0)
    assert process.plan(order(), grace_s=60.0).code == ErrorCode.SUCCESS


def test_closing_ends_a_running_plan_and_the_process() -> None:
    process = PlanningProcess()
    call = Call(process, order(time_budget_s=30.0))
    call.wait_planning()
    pid = process.pid
    assert pid is not None
    process.close()
    assert call.code() == ErrorCode.SHUTTING_DOWN
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    with pytest.raises(GraspPlannerError) as caught:
        process.plan(order(), grace_s=1.0)
    assert caught.value.code == ErrorCode.SHUTTING_DOWN
    assert process.pid is None
