"""Which grasp of an answer comes first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.order import answer_rank
from gpis_grasp_planner.grasp.trials import HoldEstimate, TrialOutcome, Trials
from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.quality.figures import Quality
from gpis_grasp_planner.quality.objective import EpsilonVolume

STILL = np.zeros(8)
GRASP = Grasp(np.eye(4), STILL, STILL, Contacts.none(), Quality(0.1, 0.01), np.eye(3)[2], 0.1)


def rank(grasp: Grasp) -> tuple[float, ...]:
    return answer_rank(grasp, EpsilonVolume(0.5))


def with_epsilon(grasp: Grasp, epsilon: float) -> Grasp:
    return replace(grasp, quality=replace(grasp.quality, epsilon=epsilon))


def tried(
    probability: float,
    *,
    held: bool = True,
    push_m: float = 0.0,
    epsilon: float = 0.1,
    hold_probability: float | None = None,
) -> Grasp:
    outcome = TrialOutcome("case", held, "" if held else "slipped", closing_slip_m=push_m)
    estimate = HoldEstimate(probability, 0.0, 1.0, 3)
    return replace(
        with_epsilon(GRASP, epsilon),
        trials=Trials((outcome,)),
        hold_estimate=estimate,
        hold_probability=hold_probability,
    )


def test_held_then_untried_then_failed_whatever_is_expected() -> None:
    untried = replace(with_epsilon(GRASP, 0.5), hold_estimate=HoldEstimate(0.99, 0.5, 1.0, 0))
    assert rank(tried(0.2)) < rank(untried) < rank(tried(0.9, held=False, epsilon=0.9))


def test_the_likelier_to_hold_comes_first_and_epsilon_breaks_ties() -> None:
    assert rank(tried(0.8, epsilon=0.05)) < rank(tried(0.6, epsilon=0.3))
    same = tried(0.81, epsilon=0.05), tried(0.79, epsilon=0.3)  # what trials cannot tell apart
    assert rank(same[1]) < rank(same[0])
    sure = tried(0.8, epsilon=0.05, hold_probability=0.9)
    assert rank(sure) < rank(tried(0.8, epsilon=0.3, hold_probability=0.7))


def test_a_hand_that_pushes_the_part_counts_as_less_likely() -> None:
    assert rank(tried(0.9)) < rank(tried(0.95, push_m=0.006))
    assert rank(tried(0.95, push_m=0.004)) < rank(tried(0.9))
    assert rank(tried(0.95, push_m=0.006)) < rank(tried(0.6))  # but not as worthless


def test_without_trials_it_is_epsilon_and_volume() -> None:
    better = with_epsilon(GRASP, 0.11), replace(GRASP, quality=Quality(0.1, 0.02))
    assert all(rank(each) < rank(GRASP) for each in better)
    unbalanced = replace(GRASP, quality=Quality(0.2, 0.01, imbalance=3.0))
    assert rank(GRASP) < rank(unbalanced)


def also(grasp: Grasp, name: str, *, passed: bool) -> Grasp:
    outcomes = (*grasp.trials.outcomes, TrialOutcome(name, passed))
    return replace(grasp, trials=Trials(outcomes))


def test_a_grasp_that_fell_where_the_part_was_planned_counts_as_less_likely() -> None:
    other, corner = "friction 0.6, 0.1 kg, bullet", "friction 0.3, 0.4 kg, mujoco"
    displaced = "friction 0.5, 0.2 kg, mujoco, displaced 3"
    for name in (other, corner):
        assert rank(tried(0.85)) < rank(also(tried(0.92), name, passed=False))
        assert rank(also(tried(0.92), name, passed=True)) < rank(tried(0.85))
    # A draw that fell is in the estimate already.
    assert rank(also(tried(0.92), displaced, passed=False)) < rank(tried(0.85))


def test_steady_are_those_that_fell_at_most_beside_their_place() -> None:
    assert tried(0.5).trials.steady
    assert not tried(0.5, held=False).trials.steady
    assert also(tried(0.5), "friction 0.5, 0.2 kg, mujoco, displaced 1", passed=False).trials.steady
