"""Which requests ask the planning process, and for what; without one."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError
from gpis_grasp_planner.geometry.catalogue import default_catalogue_directory
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.parameter_groups import parameter_groups
from gpis_grasp_planner.ros.plan_source import PlanSource
from gpis_grasp_planner.ros.settings import NodeSettings
from gpis_grasp_planner.ros.work_queue import WorkQueue
from gpis_grasp_planner.ros.worker.messages import (
    DescribeOrder,
    MeshFacts,
    PlaceOrder,
    Plan,
    PlanOrder,
)
from gpis_grasp_planner.surroundings.approach_cone import ApproachCone
from gpis_grasp_planner.surroundings.obstacles import SupportPlane, Surroundings
from gpis_grasp_planner.surroundings.place import Place

VALUES = {name: kind().as_dict() for name, kind in parameter_groups().items() if name}
REQUEST = PlanRequest(n_grasps=3)
TABLE = Place(surroundings=Surroundings(SupportPlane([0, 0, -0.1], [0, 0, 1])))
SHELF = Place(surroundings=Surroundings(SupportPlane([0, 0, -0.3], [0, 0, 1])))


class Recorded:
    """Stands in for the planning process: keeps orders, answers each with a plan."""

    def __init__(self) -> None:
        self.orders: list[Any] = []
        self.before: Callable[[], None] = lambda: None
        self.enough = True
        self.code = ErrorCode.SUCCESS

    def carry_out(self, order: PlanOrder | PlaceOrder, call: Call) -> Plan:
        self.orders.append(order)
        self.before()
        mesh_id = order.mesh_id if isinstance(order, PlanOrder) else order.plan.mesh_id
        plan = Plan(self.code, "", mesh_id, "hash", (), None, (), 1, 0.1, record=b"record")
        enough = self.enough or isinstance(order, PlanOrder)
        return replace(plan, place=order.place, enough=enough)

    def describe(self, order: DescribeOrder, call: Call) -> MeshFacts:
        self.orders.append(order)
        return MeshFacts((1.0, 2.0, 3.0), 0.5)

    def kinds(self) -> list[str]:
        return [type(order).__name__ for order in self.orders]


@pytest.fixture
def process() -> Recorded:
    return Recorded()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("mug.stl", "mug.yaml"):
        shutil.copy(default_catalogue_directory() / name, tmp_path)
    return tmp_path


@pytest.fixture
def source(process: Recorded, folder: Path) -> PlanSource:
    queue = WorkQueue(lambda: 2)
    return PlanSource(process, queue, (folder,), NodeSettings, lambda: VALUES)  # type: ignore[arg-type]


def test_a_plan_is_made_once_and_for_the_default_number(
    source: PlanSource, process: Recorded
) -> None:
    first = source.plan("mug", REQUEST, Call())
    second = source.plan("mug", replace(REQUEST, n_grasps=1), Call())
    assert (first.from_cache, second.from_cache) == (False, True)
    assert second.plan is first.plan
    [order] = process.orders
    assert order.request.n_grasps == NodeSettings().default_n_grasps
    assert order.place is None


def test_a_place_is_answered_from_what_is_known(source: PlanSource, process: Recorded) -> None:
    source.plan("mug", REQUEST, Call())
    placed = source.plan("mug", REQUEST, Call(), TABLE)
    assert placed.from_cache
    assert process.kinds() == ["PlanOrder", "PlaceOrder"]
    assert process.orders[1].place == TABLE.as_mapping()


def test_where_that_is_not_enough_a_search_begins_with_it(
    source: PlanSource, process: Recorded
) -> None:
    source.plan("mug", REQUEST, Call())
    process.enough = False
    placed = source.plan("mug", REQUEST, Call(), TABLE)
    assert not placed.from_cache
    assert process.kinds() == ["PlanOrder", "PlaceOrder", "PlanOrder"]
    assert process.orders[2].known == b"record"
    assert process.orders[2].place == TABLE.as_mapping()


def test_what_placing_has_cost_is_taken_off_the_search(
    source: PlanSource, process: Recorded
) -> None:
    """The stand-in's plans take 0.1 s each."""
    source.plan("mug", REQUEST, Call(), TABLE)
    process.enough = False
    source.plan("mug", REQUEST, Call(), SHELF)
    assert process.kinds() == ["PlanOrder", "PlaceOrder", "PlanOrder"]
    budgets = [order.request.time_budget_s for order in process.orders]
    assert budgets == [REQUEST.time_budget_s] * 2 + [REQUEST.time_budget_s - 0.1]


def test_a_failure_is_not_kept(source: PlanSource, process: Recorded) -> None:
    process.code = ErrorCode.NO_FEASIBLE_GRASP
    for _ in range(2):
        assert not source.plan("mug", REQUEST, Call()).from_cache
    assert process.kinds() == ["PlanOrder", "PlanOrder"]


def test_a_file_that_changes_meanwhile_is_noted_and_not_kept(
    source: PlanSource, process: Recorded, folder: Path
) -> None:
    sidecar = folder / "mug.yaml"
    process.before = lambda: sidecar.write_text(sidecar.read_text() + "\n# changed\n")
    delivered = source.plan("mug", REQUEST, Call())
    assert "changed while it was planned on" in delivered.plan.notes[-1]
    process.before = lambda: None
    assert not source.plan("mug", REQUEST, Call()).from_cache


def test_a_cone_in_the_world_needs_the_pose_though_nothing_stands_around(
    source: PlanSource, process: Recorded
) -> None:
    down = ApproachCone(np.array([0.0, 0.0, -1.0]), 30.0)
    source.plan("mug", replace(REQUEST, approach=down), Call(), Place())
    own = replace(REQUEST, approach=replace(down, frame="object"))
    source.plan("mug", own, Call(), Place())
    assert [order.place for order in process.orders] == [Place().as_mapping(), None]


def test_what_is_known_is_answered_without_a_search(source: PlanSource, process: Recorded) -> None:
    with pytest.raises(GraspPlannerError, match="plan_grasp") as caught:
        source.known("mug", REQUEST, Call())
    assert caught.value.code == ErrorCode.NOTHING_KNOWN
    made = source.plan("mug", REQUEST, Call())
    assert source.known("mug", REQUEST, Call()).plan is made.plan
    process.enough = False
    assert source.known("mug", REQUEST, Call(), SHELF).plan.place == SHELF.as_mapping()
    assert process.kinds() == ["PlanOrder", "PlaceOrder"]


def test_a_mesh_is_measured_once_until_its_file_changes(
    source: PlanSource, process: Recorded, folder: Path
) -> None:
    assert source.facts("mug", Call(), measure=False) is None
    for _ in range(2):
        assert source.facts("mug", Call(), measure=True) == MeshFacts((1.0, 2.0, 3.0), 0.5)
    assert process.kinds() == ["DescribeOrder"]
    (folder / "mug.yaml").write_text("unit: mm\n")
    assert source.facts("mug", Call(), measure=False) is None


def test_a_directory_that_is_gone_is_told_without_its_path(
    source: PlanSource, folder: Path
) -> None:
    shutil.rmtree(folder)
    with pytest.raises(GraspPlannerError, match="Directory 1 of 1") as caught:
        source.check_mesh_id("mug")
    assert caught.value.code == ErrorCode.INVALID_SETTING
    assert str(folder) not in caught.value.message


def test_a_cancelled_call_asks_for_nothing(source: PlanSource, process: Recorded) -> None:
    call = Call()
    call.cancel("Cancelled by its client.")
    with pytest.raises(GraspPlannerError, match="by its client"):
        source.plan("mug", REQUEST, call)
    assert process.orders == []


def test_a_place_is_kept_for_what_is_known_to_need_one_alone(
    source: PlanSource, process: Recorded
) -> None:
    """The queue has room for two, and one may be searched for."""
    for _ in range(5):
        source.reserve("mug", 7, Call())  # nobody asked for this mesh before: it may be wrong
    source.check_mesh_id("mug")
    calls = [Call() for _ in range(3)]
    for call in calls:
        source.reserve("mug", 7, call)
    with pytest.raises(GraspPlannerError) as caught:
        source.reserve("mug", 7, Call())
    assert caught.value.code == ErrorCode.BUSY
    made = source.plan("mug", replace(REQUEST, seed=7), calls[0])
    assert not made.from_cache
    for _ in range(5):
        source.reserve("mug", 7, Call())  # the answer may be in memory
    for call in calls:
        source.release(call)
    for call in calls:
        source.reserve("mug", 8, call)
