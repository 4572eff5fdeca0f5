"""Requests: limits, and messages with value, limit and next step."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.part import FRICTION_RANGE, Friction
from gpis_grasp_planner.plan.request import (
    GRASP_COUNT_RANGE,
    SEED_LIMIT,
    TIME_BUDGET_RANGE_S,
    PlanRequest,
    check_friction,
)
from gpis_grasp_planner.search.searches import PLANNERS, check_planner, planner_names


@pytest.mark.parametrize("budget", [-1.0, 0.0, 0.0999, 600.1, np.inf, -np.inf, np.nan])
def test_time_budget_out_of_range(budget):
    with pytest.raises(RequestError) as error:
        PlanRequest(time_budget_s=budget)
    assert error.value.code is ErrorCode.TIME_BUDGET_OUT_OF_RANGE
    assert str(error.value) == (
        f"The time budget is {budget} s; allowed are 0.1 to 600 s. "
        "Ask again with a budget in that range."
    )


@pytest.mark.parametrize("n", [-3, 0, 201, 10**12])
def test_grasp_count_out_of_range(n):
    with pytest.raises(RequestError) as error:
        PlanRequest(n_grasps=n)
    assert error.value.code is ErrorCode.GRASP_COUNT_OUT_OF_RANGE
    assert str(error.value) == (
        f"The number of grasps is {n}; allowed are 1 to 200. Ask again with a number in that range."
    )


@pytest.mark.parametrize("value", [-0.5, 0.0, 0.00999, 5.01, np.nan, np.inf])
@pytest.mark.parametrize("where", ["finger", "palm"])
def test_friction_out_of_range(value, where):
    friction = Friction(**{"finger": 0.6, "palm": 0.6, where: value})
    with pytest.raises(RequestError) as error:
        PlanRequest(friction=friction)
    assert error.value.code is ErrorCode.FRICTION_OUT_OF_RANGE
    assert str(error.value) == (
        f"The friction of the {where} is {value}; allowed are 0.01 to 5. "
        "Ask again with a coefficient in that range."
    )


@pytest.mark.parametrize("seed", [-1, 2**63])
def test_seed_out_of_range(seed):
    with pytest.raises(RequestError, match=re.escape(f"The seed is {seed}; ")) as error:
        PlanRequest(seed=seed)
    assert f"0 to {2**63 - 1}" in str(error.value)


@pytest.mark.parametrize("limit", [0, -7])
def test_limit_of_evaluations_out_of_range(limit):
    with pytest.raises(RequestError, match=f"is {limit}; give at least 1, or none"):
        PlanRequest(max_evaluations=limit)


def test_the_limits_themselves_are_allowed():
    for budget in TIME_BUDGET_RANGE_S:
        assert PlanRequest(time_budget_s=budget).time_budget_s == budget
    for n in GRASP_COUNT_RANGE:
        assert PlanRequest(n_grasps=n).n_grasps == n
    for seed in (0, SEED_LIMIT):
        assert PlanRequest(seed=seed).seed == seed
    for mu in FRICTION_RANGE:
        assert check_friction(mu, "finger") == mu
        assert PlanRequest(friction=Friction(mu, mu)).friction == Friction(mu, mu)
    assert PlanRequest(max_evaluations=1).max_evaluations == 1


def test_friction_is_the_requests_then_the_parts_then_the_default():
    own, parts = Friction(0.3, 0.2), Friction(0.4, 0.5)
    assert PlanRequest(friction=own).friction_for(parts) == own
    assert PlanRequest().friction_for(parts) == parts
    assert PlanRequest().friction_for(None) == Friction(0.6, 0.6)


@pytest.mark.parametrize("name", ["", "Dual", "anneal me", "hpp "])
def test_unknown_planner_names_the_known(name):
    with pytest.raises(RequestError) as error:
        check_planner(name)
    assert error.value.code is ErrorCode.UNKNOWN_PLANNER
    assert (
        str(error.value) == f"Unknown planner '{name}'; choose one of {', '.join(planner_names())}."
    )


def test_the_papers_planners_and_the_ablations_are_there():
    assert {"dual", "hpp", "paper", "random", "random-adaption"} <= set(PLANNERS)
    assert PlanRequest().planner == "dual"
    assert [check_planner(name) for name in PLANNERS] == list(PLANNERS)


@pytest.mark.parametrize(
    ("spent_s", "left_s"), [(0.0, 10.0), (0.05, 10.0), (2.0, 8.0), (5.0, 5.0), (60.0, 5.0)]
)
def test_again_gets_what_is_left_but_half_at_least(spent_s, left_s):
    request = PlanRequest(time_budget_s=10.0, seed=3)
    again = request.again(spent_s)
    assert again.time_budget_s == left_s
    assert replace(again, time_budget_s=10.0) == request
