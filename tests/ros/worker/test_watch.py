"""The watched process: plans, errors, and what happens when it dies, hangs or is closed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError
from gpis_grasp_planner.geometry.catalogue import default_catalogue_directory
from gpis_grasp_planner.plan.progress import Phase
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.parameter_groups import parameter_groups
from gpis_grasp_planner.ros.worker.messages import PlaceOrder, Plan, PlanOrder
from gpis_grasp_planner.ros.worker.supervisor import WorkerSupervisor, WorkLimits
from gpis_grasp_planner.ros.worker.watch import PlanningProcess

VALUES = {name: kind().as_dict() for name, kind in parameter_groups().items() if name}


def order(mesh_id: str = "sphere", time_budget_s: float | None = None) -> PlanOrder:
    """A plan that ends after so many seconds, or after some attempts, however slow the machine."""
    few = PlanRequest(planner="hpp", time_budget_s=60.0, n_grasps=2, max_evaluations=200)
    request = few
    if time_budget_s is not None:
        request = replace(few, time_budget_s=time_budget_s, max_evaluations=None)
    return PlanOrder(mesh_id, (str(default_catalogue_directory()),), request, VALUES)


class Worked:
    """The watched process with limits that a test may change."""

    def __init__(self) -> None:
        self.limits = WorkLimits(grace_s=60.0, preparation_s=120.0)
        self.events: list[str] = []
        self.supervisor = WorkerSupervisor(lambda: self.limits, self.events.append)
        self._process = PlanningProcess(self.supervisor)

    def carry_out(self, order: Any, grace_s: float = 60.0, **limits: Any) -> Plan:
        self.limits = replace(WorkLimits(grace_s, 120.0), **limits)
        return self._process.carry_out(order, Call())

    def start(self, order: Any, grace_s: float = 60.0, **limits: Any) -> Started:
        self.limits = replace(WorkLimits(grace_s, 120.0), **limits)
        return Started(self._process, order)

    @property
    def pid(self) -> int:
        pid = self.supervisor.pid
        assert pid is not None
        return pid


class Started(threading.Thread):
    """An order carried out in a thread of its own, and how it ended."""

    def __init__(self, process: Worked, order: Any) -> None:
        super().__init__()
        self.result: Plan | GraspPlannerError | None = None
        self.call = Call()
        self._process, self._order = process, order
        self.start()

    def run(self) -> None:
        try:
            self.result = self._process.carry_out(self._order, self.call)
        except GraspPlannerError as error:
            self.result = error

    def wait_for(self, *phases: Phase) -> None:
        """Wait until the work has reached one of these phases, or any."""
        end = time.monotonic() + 90.0
        while self.call.progress is None or (phases and self.call.progress.phase not in phases):
            assert self.is_alive(), self.result
            assert time.monotonic() < end
            time.sleep(0.005)

    def code(self) -> ErrorCode:
        self.join(90.0)
        assert self.result is not None
        return self.result.code


def gone(pid: int) -> bool:
    """Whether a process ends within 10 s."""
    for _ in range(1000):
        stat = Path(f"/proc/{pid}/stat")
        if not stat.exists() or ") Z " in stat.read_text():
            return True
        time.sleep(0.01)
    return False


@pytest.fixture(scope="module")
def process() -> Iterator[Worked]:
    made = Worked()
    yield made
    made.supervisor.close()


def test_a_plan_comes_back(process: Worked) -> None:
    plan = process.carry_out(order())
    assert plan.code == ErrorCode.SUCCESS
    assert 1 <= len(plan.grasps) <= 2
    assert plan.grasps[0].epsilon > 0.0
    assert len(plan.mesh_hash) == 64
    assert process.supervisor.ready


def test_waiting_for_the_start_is_part_of_the_time() -> None:
    """The planner itself is told of what is left: its imports take half a second at least."""
    made = Worked()
    try:
        started = made.start(order(time_budget_s=8.0))
        assert started.code() == ErrorCode.SUCCESS
        told = started.call.progress
    finally:
        made.supervisor.close()
    assert told is not None
    assert 4.0 <= told.time_budget_s < 7.7


def test_the_planners_errors_keep_code_and_message(process: Worked) -> None:
    pid = process.pid
    with pytest.raises(GraspPlannerError, match=r"'spere' is unknown.*sphere") as caught:
        process.carry_out(order("spere"))
    assert caught.value.code == ErrorCode.UNKNOWN_MESH
    assert process.pid == pid


def test_an_unexpected_error_is_an_answer_too(process: Worked) -> None:
    broken = PlanOrder("sphere", (), PlanRequest(), {})
    with pytest.raises(GraspPlannerError) as caught:
        process.carry_out(broken)
    assert caught.value.code == ErrorCode.INTERNAL
    assert "KeyError" in caught.value.message


REQUEST = PlanRequest(planner="hpp", n_grasps=1, time_budget_s=60.0)


def place_order(plan: Plan) -> PlaceOrder:
    """A sphere on a table."""
    place = {"support": {"point": [0.0, 0.0, -0.05]}}
    return PlaceOrder(plan, (str(default_catalogue_directory()),), place, REQUEST, VALUES)


def test_a_plan_is_placed_while_another_is_made(process: Worked) -> None:
    plan = process.carry_out(order())
    running = process.start(order(time_budget_s=6.0))
    running.wait_for(Phase.SEARCHING)
    answers = [process.carry_out(place_order(plan)) for _ in range(2)]
    assert running.is_alive()
    for placed in answers:
        assert placed.code in (ErrorCode.SUCCESS, ErrorCode.ALL_GRASPS_BLOCKED)
        assert placed.record == b""
        assert len(placed.grasps) <= 1
    assert running.code() == ErrorCode.SUCCESS


def test_errors_of_placing_are_answered_and_do_not_end_the_process(
    process: Worked,
) -> None:
    plan = process.carry_out(order())
    pid = process.pid
    refused: tuple[tuple[dict[str, Any], ErrorCode], ...] = (
        ({"place": {"table": 1}}, ErrorCode.INVALID_SCENE),
        ({"place": {"covariance": [-1.0] * 6}}, ErrorCode.INVALID_COVARIANCE),
        ({"plan": replace(plan, mesh_hash="0" * 64, record=b"other")}, ErrorCode.MESH_UNREADABLE),
        ({"settings": {}}, ErrorCode.INTERNAL),
    )
    for changes, code in refused:
        with pytest.raises(GraspPlannerError) as caught:
            process.carry_out(replace(place_order(plan), **changes))
        assert caught.value.code == code
    assert process.pid == pid


def test_a_plan_is_placed_by_the_next_process(process: Worked) -> None:
    """Stopped before it takes the order; nothing that it knew is needed by the next one."""
    plan = process.carry_out(order())
    before = process.carry_out(place_order(plan))
    stopped = process.pid
    os.kill(stopped, signal.SIGSTOP)
    after = process.carry_out(place_order(plan), retries=1)
    assert process.pid != stopped
    assert after.code == before.code
    for one, other in zip(before.grasps, after.grasps, strict=True):
        assert np.array_equal(one.T_object_palm, other.T_object_palm)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV])
def test_a_death_is_answered_and_the_next_plan_made(
    process: Worked, number: signal.Signals
) -> None:
    call = process.start(order(time_budget_s=30.0))
    call.wait_for(Phase.SEARCHING)
    dead = process.pid
    os.kill(dead, number)
    assert call.code() == ErrorCode.PLANNING_PROCESS_LOST
    assert number.name in str(call.result)
    assert process.pid != dead
    assert process.carry_out(order()).code == ErrorCode.SUCCESS


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_loss_while_idle_is_no_matter(process: Worked, number: signal.Signals) -> None:
    process.supervisor.ensure_started()
    dead = process.pid
    os.kill(dead, number)
    assert process.carry_out(order(), retries=1).code == ErrorCode.SUCCESS
    assert process.pid != dead


def test_the_order_of_a_stopped_process_is_given_to_the_next_one(process: Worked) -> None:
    """Long before its deadline."""
    call = process.start(order(time_budget_s=10.0), grace_s=600.0, retries=1)
    call.wait_for(Phase.SEARCHING)
    stopped = process.pid
    os.kill(stopped, signal.SIGSTOP)
    assert call.code() == ErrorCode.SUCCESS
    assert process.pid != stopped
    with pytest.raises(ProcessLookupError):
        os.kill(stopped, 0)


def test_a_process_without_an_answer_is_given_up_at_the_deadline(process: Worked) -> None:
    """It says every second that it is there. The grace is negative: it cannot be done by then."""
    process.carry_out(order())
    late = process.pid
    call = process.start(order(time_budget_s=60.0), grace_s=-57.0)
    assert call.code() == ErrorCode.DEADLINE_EXCEEDED
    assert "60 s" in str(call.result)
    assert "-57 s" in str(call.result)
    assert process.pid != late
    assert process.carry_out(order()).code == ErrorCode.SUCCESS


def test_a_process_stands_back_as_far_as_it_is_told(process: Worked) -> None:
    process.carry_out(order())
    for nice in (0, 7):
        process.limits = replace(process.limits, nice=nice)
        os.kill(process.pid, signal.SIGKILL)
        process.carry_out(order(), retries=1, nice=nice)
        assert os.getpriority(os.PRIO_PROCESS, process.pid) == min(
            os.getpriority(os.PRIO_PROCESS, 0) + nice, 19
        )


def test_closing_ends_a_running_plan_and_the_process() -> None:
    process = Worked()
    call = process.start(order(time_budget_s=30.0))
    call.wait_for()
    pid = process.pid
    process.supervisor.close()
    assert call.code() == ErrorCode.SHUTTING_DOWN
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    with pytest.raises(GraspPlannerError) as caught:
        process.carry_out(order(), grace_s=1.0)
    assert caught.value.code == ErrorCode.SHUTTING_DOWN
    assert process.supervisor.pid is None


def test_an_order_whose_process_died_is_given_to_the_next_one(process: Worked) -> None:
    call = process.start(order(time_budget_s=10.0), retries=1)
    call.wait_for(Phase.SEARCHING)
    dead = process.pid
    os.kill(dead, signal.SIGKILL)
    assert call.code() == ErrorCode.SUCCESS
    assert process.pid != dead
    assert any("next process" in event for event in process.events)


@pytest.mark.parametrize("phase", [Phase.SEARCHING, Phase.TRYING])
def test_a_cancel_is_answered_and_the_process_works_on(process: Worked, phase: Phase) -> None:
    request = replace(order(time_budget_s=20.0).request, verification="rank")
    call = process.start(replace(order(), request=request))
    call.wait_for(phase)
    pid, began = process.pid, time.monotonic()
    call.call.cancel("Cancelled by its client.")
    assert call.code() == ErrorCode.CANCELLED
    assert time.monotonic() - began < 15.0  # a bound on a hang; the node's benchmark measures
    assert process.carry_out(order()).code == ErrorCode.SUCCESS
    assert process.pid == pid


def test_a_cancel_before_the_process_is_ready_is_answered(process: Worked) -> None:
    os.kill(process.pid, signal.SIGKILL)
    call = process.start(order())
    call.call.cancel("Cancelled by its client.")
    assert call.code() == ErrorCode.CANCELLED


def test_what_was_slow_to_prepare_goes_on_and_is_kept(process: Worked) -> None:
    """The caller is answered in time; the process is not killed, and the next call waits for it."""
    process.carry_out(order())
    pid = process.pid
    slow = replace(order("housing", time_budget_s=0.1), read_limit_s=30.0)
    with pytest.raises(GraspPlannerError, match="goes on") as caught:
        process.carry_out(slow, grace_s=0.05)
    assert caught.value.code == ErrorCode.DEADLINE_EXCEEDED
    assert process.carry_out(order("housing")).code == ErrorCode.SUCCESS
    assert process.pid == pid


def test_preparation_that_hangs_is_given_up_at_its_limit(process: Worked) -> None:
    process.carry_out(order())
    stopped = process.pid
    with pytest.raises(GraspPlannerError):
        process.carry_out(order("flange", time_budget_s=0.1), grace_s=0.05)
    os.kill(stopped, signal.SIGSTOP)
    assert process.carry_out(order(), retries=1).code == ErrorCode.SUCCESS
    assert process.pid != stopped


def test_a_process_that_has_grown_is_replaced_between_two_orders(process: Worked) -> None:
    grown = process.pid
    assert process.carry_out(order(), memory_bytes=1e6).code == ErrorCode.SUCCESS
    running = process.start(order(time_budget_s=4.0), memory_bytes=1e6)
    end = time.monotonic() + 90.0
    while process.pid == grown:
        assert time.monotonic() < end
        time.sleep(0.05)
    assert running.code() == ErrorCode.SUCCESS
    process.limits = WorkLimits(60.0, 120.0)
    assert gone(grown)  # with its last order
    assert process.carry_out(order()).code == ErrorCode.SUCCESS
    assert any("was replaced" in event for event in process.events)


def test_a_stopped_process_does_not_outlive_its_killed_parent() -> None:
    program = """
import os, signal, time
from gpis_grasp_planner.ros.worker.supervisor import WorkerSupervisor, WorkLimits
supervisor = WorkerSupervisor(lambda: WorkLimits(1.0, 1.0))
link = supervisor.current()
link.wait_ready(90.0)
os.kill(link.pid, signal.SIGSTOP)
print(link.pid, flush=True)
time.sleep(60.0)
"""
    parent = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    worker = int(parent.stdout.readline())
    parent.kill()
    parent.communicate()
    assert gone(worker)
