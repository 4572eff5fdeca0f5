"""Plans in memory: what makes two requests the same, and what is forgotten first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.ros.plan_cache import PlanCache, PlanKey, plan_key
from gpis_grasp_planner.ros.worker.messages import Plan, PlanOrder
from gpis_grasp_planner.surroundings.obstacles import SupportPlane, Surroundings
from gpis_grasp_planner.surroundings.place import Place

ORDER = PlanOrder("mug", ("/parts",), PlanRequest(), {"scene": {"cone_edges": 8}})


def key(digest: str) -> PlanKey:
    return PlanKey("mug", 0, digest)


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


def test_the_place_and_what_was_known_are_not() -> None:
    first = replace(ORDER, place=TABLE.as_mapping(), known=b"record")
    assert plan_key(first, "f") == plan_key(ORDER, "f")


def table(height: float) -> Place:
    return Place(surroundings=Surroundings(SupportPlane([0, 0, height], [0, 0, 1])))


TABLE = table(-0.05)


def test_plans_for_several_places_are_kept_side_by_side() -> None:
    cache = PlanCache(8)
    free, low = plan("free"), replace(plan("low"), place=TABLE.as_mapping())
    high = replace(plan("high"), place=table(-0.03).as_mapping())
    for each in (free, low, high):
        cache.put(key("k"), each)
    assert cache.get(key("k")) is free
    assert cache.get(key("k"), TABLE) is low
    assert cache.get(key("k"), table(-0.0301)) is high
    # elsewhere the one that was last used is the beginning of a new plan
    assert cache.get(key("k"), table(-0.2)) is high
    newer = replace(plan("newer"), place=table(-0.051).as_mapping())
    cache.put(key("k"), newer)
    assert cache.get(key("k"), TABLE) is newer
    assert len(cache) == 3
    assert cache.get(key("other"), TABLE) is None


def test_the_file_is_in_the_key() -> None:
    assert plan_key(ORDER, "f") != plan_key(ORDER, "g")


def test_the_least_recently_used_goes_first() -> None:
    cache = PlanCache(2)
    first, second, third = plan("first"), plan("second"), plan("third")
    cache.put(key("1"), first)
    cache.put(key("2"), second)
    assert cache.get(key("1")) is first
    cache.put(key("3"), third)
    assert cache.get(key("2")) is None
    assert cache.get(key("1")) is first
    assert cache.get(key("3")) is third
    assert len(cache) == 2


def test_a_cache_of_size_zero_keeps_nothing() -> None:
    cache = PlanCache(0)
    cache.put(key("1"), plan("first"))
    assert cache.get(key("1")) is None


def test_before_an_arm_a_plan_is_for_one_pose() -> None:
    near, far = np.eye(4), np.eye(4)
    far[0, 3] = 0.2
    cache = PlanCache(4)
    for name, T in (("near", near), ("far", far)):
        place = Place(T, T_world_arm=np.eye(4))
        cache.put(key("key"), replace(plan(name), place=place.as_mapping()))
    assert cache.count("near") == cache.count("far") == 1
    for name, T in (("near", near), ("far", far)):
        found = cache.get(key("key"), Place(T, T_world_arm=np.eye(4)))
        assert found is not None
        assert found.message == name


def test_a_plan_may_be_here_only_where_mesh_and_seed_are_those_of_one() -> None:
    cache, order = PlanCache(1), replace(ORDER, request=replace(ORDER.request, seed=3))
    assert not cache.may_have("mug", 3)
    cache.put(plan_key(order, "f"), plan("mug"))
    assert cache.may_have("mug", 3)
    assert not cache.may_have("mug", 0)
    assert not cache.may_have("flask", 3)
    cache.put(key("newer"), plan("mug"))
    assert not cache.may_have("mug", 3)
    assert cache.may_have("mug", 0)
