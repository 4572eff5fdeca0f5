"""What is expected of a grasp before and after trials, its own and those of others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import beta

from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.trials import TrialOutcome, Trials
from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.quality.figures import Quality
from gpis_grasp_planner.verification.hold_model import BetaPosterior, HoldModel, features_of

STILL = np.zeros(8)


def grasp(x_mm: float = 0.0, epsilon: float = 0.1, imbalance: float | None = 0.0) -> Grasp:
    T = np.eye(4)
    T[0, 3] = 1e-3 * x_mm
    quality = Quality(epsilon, 2.0 * epsilon**2, imbalance)
    return Grasp(T, STILL, STILL, Contacts.none(), quality, T[:3, 2], 0.1)


def outcomes(marks: str) -> tuple[TrialOutcome, ...]:
    return tuple(TrialOutcome(str(i), mark == "+") for i, mark in enumerate(marks))


def tried(grasp: Grasp, marks: str) -> Grasp:
    return replace(grasp, trials=Trials(outcomes(marks)))


def test_more_epsilon_and_more_balance_are_more_likely_to_hold() -> None:
    model = HoldModel()
    order = [grasp(epsilon=0.2), grasp(epsilon=0.03), grasp(epsilon=0.03, imbalance=3.0)]
    expected = [model.estimate(each).probability for each in order]
    assert expected == sorted(expected, reverse=True)
    assert expected[0] > 0.6
    assert expected[2] < 0.4


def test_its_own_trials_decide() -> None:
    model, weak = HoldModel(), grasp(epsilon=0.02)
    alone = model.estimate(tried(weak, "+"))
    held = model.estimate(tried(weak, "+" * 14))
    half = model.estimate(tried(weak, "+" + "+-" * 6))
    failed = model.estimate(tried(weak, "-"))
    assert failed.probability < 0.03 < half.probability < held.probability
    assert abs(half.probability - 0.5) < 0.15
    assert held.n == 13
    assert alone.n == failed.n == 0
    assert held.high - held.low < alone.high - alone.low
    for estimate in (alone, held, half, failed):
        assert 0.0 <= estimate.low <= estimate.probability <= estimate.high <= 1.0


def test_the_interval_is_that_of_the_beta_distribution() -> None:
    model, some = HoldModel(), tried(grasp(), "+++-+")
    posterior = model.posterior(some, some.trials.outcomes)
    estimate = model.estimate(some)
    low, high = beta.interval(0.9, posterior.alpha, posterior.beta)
    assert estimate.low == pytest.approx(low)
    assert estimate.high == pytest.approx(high)
    assert estimate.probability == pytest.approx(beta.mean(posterior.alpha, posterior.beta))
    assert BetaPosterior(3.0, 1.0).quantile(0.5) == pytest.approx(beta.median(3.0, 1.0))


def test_trials_of_others_tell_of_those_not_tried() -> None:
    model, other = HoldModel(), grasp(300.0)
    before = model.estimate(other).probability
    for i in range(6):
        model.learn(grasp(20.0 * i), outcomes("+" + "-" * 10))
    worse = model.estimate(other).probability
    assert worse < before - 0.2
    better = HoldModel()
    for i in range(6):
        better.learn(grasp(20.0 * i), outcomes("+" * 14))
    assert better.estimate(other).probability > before


def test_outcomes_replace_what_was_told_of_a_grasp_before() -> None:
    once, twice = HoldModel(), HoldModel()
    for marks in ("+", "++", "++-"):
        once.learn(grasp(), outcomes(marks))
    twice.learn(grasp(), outcomes("++-"))
    other = grasp(100.0)
    assert once.estimate(other) == twice.estimate(other)


def test_without_figures_features_are_finite() -> None:
    bare = replace(grasp(), quality=Quality(-1.0, 0.0))
    assert np.isfinite(features_of(bare)).all()
    estimate = HoldModel().estimate(bare)
    assert 0.0 < estimate.probability < 0.5


def test_of_a_scanned_part_as_much_is_expected_as_its_surfaces_let_close() -> None:
    model, known = HoldModel(), grasp()
    half = replace(known, quality=replace(known.quality, measured={"surface_hold": 0.5}))
    whole = model.estimate(known).probability
    assert model.estimate(half).probability == pytest.approx(0.5 * whole)
    # Half of its draws fell, as its surfaces say: of grasps on a sure surface nothing is learnt.
    sure, unsure = HoldModel(), HoldModel()
    sure.learn(grasp(1.0), outcomes("+" * 7))
    unsure.learn(replace(grasp(1.0), quality=half.quality), outcomes("+" + "+" * 6 + "-" * 6))
    other = grasp(2.0)
    assert unsure.estimate(other).probability == pytest.approx(sure.estimate(other).probability)
