"""Plans in memory: what makes two requests the same, and what is forgotten first."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.ros.plan_cache import PlanCache, plan_key
from gpis_grasp_planner.ros.worker.messages import Plan, PlanOrder

ORDER = PlanOrder("mug", ("/parts",), PlanRequest(), {"scene": {"cone_edges": 8}})


def plan(name: str) -> Plan:
    return Plan(ErrorCode.SUCCESS, name, name, "hash", (), None, (), 1, 0.1)


def test_equal_orders_have_equal_keys() -> None:
    other = PlanOrder("mug", ("/parts",), PlanRequest(), {"scene": {"cone_edges": 8}})
    assert plan_key(ORDER, "f") == plan_key(other, "f")


@pytest.mark.parametrize(
    "other",
    [
        replace(ORDER, mesh_id="flask"),
        replace(ORDER, mesh_directories=("/other",)),
        replace(ORDER, request=replace(ORDER.request, seed=1)),
        replace(ORDER, request=replace(ORDER.request, time_budget_s=2.0)),
        replace(ORDER, request=replace(ORDER.request, n_grasps=21)),
        replace(ORDER, request=replace(ORDER.request, planner="hpp")),
        replace(ORDER, request=replace(ORDER.request, verification="require")),
        replace(ORDER, request=replace(ORDER.request, friction=Friction(0.5, 0.5))),
        replace(ORDER, settings={"scene": {"cone_edges": 9}}),
    ],
)
def test_whatever_decides_a_plan_is_in_the_key(other: PlanOrder) -> None:
    assert plan_key(other, "f") != plan_key(ORDER, "f")


@pytest.mark.parametrize("group", ["clearance", "uncertainty"])
def test_what_is_done_with_a_plan_afterwards_is_not(group: str) -> None:
    other = replace(ORDER, settings={**ORDER.settings, group: {"value": 1}})
    assert plan_key(other, "f") == plan_key(ORDER, "f")


def test_the_place_that_the_trials_follow_is_not() -> None:
    first = replace(ORDER, present={"support": {"point": [0, 0, 0], "normal": [0, 0, 1]}})
    assert plan_key(first, "f") == plan_key(ORDER, "f")


def test_the_file_is_in_the_key() -> None:
    assert plan_key(ORDER, "f") != plan_key(ORDER, "g")


def test_the_least_recently_used_goes_first() -> None:
    cache = PlanCache(2)
    first, second, third = plan("first"), plan("second"), plan("third")
    cache.put("1", first)
    cache.put("2", second)
    assert cache.get("1") is first
    cache.put("3", third)
    assert cache.get("2") is None
    assert cache.get("1") is first
    assert cache.get("3") is third
    assert len(cache) == 2


def test_a_cache_of_size_zero_keeps_nothing() -> None:
    cache = PlanCache(0)
    cache.put("1", plan("first"))
    assert cache.get("1") is None
