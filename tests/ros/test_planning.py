"""What the node plans with, on a real node: its configuration, its limits, its successor."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from real_node import real_node

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError, PlanningError, SystemFault
from gpis_grasp_planner.geometry.catalogue import default_catalogue_directory
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.parameters import NodeParameters
from gpis_grasp_planner.ros.planning import Planning
from gpis_grasp_planner.ros.worker.supervisor import WorkLimits


@contextmanager
def planning(arguments: str = "") -> Iterator[tuple[Node, Planning]]:
    with real_node(lambda context: Node("planning", context=context), arguments) as node:
        made = Planning(node, NodeParameters(node))
        try:
            yield node, made
        finally:
            made.close()


def set_all(node: Node, **values: object) -> None:
    results = node.set_parameters([Parameter(name, value=value) for name, value in values.items()])
    assert all(result.successful for result in results)


def test_without_directories_it_offers_the_shipped_parts() -> None:
    with planning() as (_, made):
        shipped = {path.stem for path in default_catalogue_directory().glob("*.stl")}
        assert shipped <= set(made.catalogue.ids())
        assert made.hand.name.startswith("barrett")
        assert made.supervisor.pid is not None
        assert made.supervisor.starts == 1


def test_files_that_cannot_be_asked_for_are_named_in_the_log(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for name in ("mug.stl", "two words.stl"):
        shutil.copy(default_catalogue_directory() / "mug.stl", tmp_path / name)
    with planning(f"-p mesh_directories:=[{tmp_path}]") as (_, made):
        assert made.catalogue.ids() == ["mug"]
        assert made.plans.listed()[0] == ["mug"]
        path, scale = made.plain_file("mug") or (None, None)
        assert path == tmp_path / "mug.stl"
        assert scale is not None
    logged, deadline = capfd.readouterr().err, time.monotonic() + 10.0
    while "two words.stl cannot be asked for" not in logged and time.monotonic() < deadline:
        logged += capfd.readouterr().err
    assert "two words.stl cannot be asked for" in logged


def test_limits_are_those_of_the_parameters_at_every_moment() -> None:
    with planning("-p worker_nice:=2 -p retries_of_lost_orders:=0") as (node, made):
        before = made.supervisor.limits()
        assert (before.nice, before.retries) == (2, 0)
        set_all(
            node,
            planning_grace_s=7.0,
            mesh_preparation_limit_s=77.0,
            worker_memory_limit_mb=1500.0,
            retries_of_lost_orders=1,
        )
        assert made.supervisor.limits() == WorkLimits(7.0, 77.0, 1, 1.5e9, 2)


@pytest.mark.parametrize("argument", ["mesh_directories:=[/no/such]", "hand.model:=claw"])
def test_what_it_cannot_plan_with_is_refused_before_a_process_is_started(argument: str) -> None:
    with (
        real_node(lambda c: Node("planning", context=c), f"-p {argument}") as node,
        pytest.raises(GraspPlannerError, match=argument.rpartition(":=")[2].strip("[]")),
    ):
        Planning(node, NodeParameters(node))
    assert not [
        pid
        for task in Path("/proc/self/task").iterdir()
        for pid in (task / "children").read_text().split()
    ]


def test_after_the_end_requests_are_told_so() -> None:
    with planning() as (_, made):
        pid = made.supervisor.pid
        made.close()
        assert not Path(f"/proc/{pid}").exists()
        with pytest.raises(SystemFault) as caught:
            made.plans.plan("mug", PlanRequest(), Call())
        assert caught.value.code is ErrorCode.SHUTTING_DOWN
        assert made.queue.n_running == made.queue.n_waiting == 0


def test_a_successor_has_the_plans_and_a_process_of_its_own() -> None:
    with planning("-p default_n_grasps:=1") as (_, made):
        # So many attempts, however slow the machine.
        request = PlanRequest("hpp", time_budget_s=60.0, n_grasps=1, max_evaluations=200)
        plan = made.plans.plan("sphere", request, Call())
        assert plan.plan.code == ErrorCode.SUCCESS
        pid, successor = made.supervisor.pid, made.renewed()
        try:
            assert not Path(f"/proc/{pid}").exists()
            assert successor.supervisor.pid not in (None, pid)
            known = successor.plans.known("sphere", request, Call())
            assert known.from_cache
            assert known.plan is plan.plan
            with pytest.raises(PlanningError) as caught:
                successor.plans.known("mug", request, Call())
            assert caught.value.code is ErrorCode.NOTHING_KNOWN
        finally:
            successor.close()
