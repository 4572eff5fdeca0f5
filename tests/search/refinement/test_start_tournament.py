"""The tournament of first-stage grasps: who starts, who goes on, and what it finds."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.search.refinement.neighbourhood import Neighbourhood
from gpis_grasp_planner.search.refinement.start_tournament import StartTournament
from gpis_grasp_planner.search.settings import RefinementSettings


@pytest.fixture
def tournament(sphere, make_context, recording_evaluator, oracle):
    """A tournament over grasps at (n, 3) places with given figures: (it, its context)."""

    def make(places, epsilon, figures=None, seed=0, **settings):
        groups = PlannerSettings(refinement=RefinementSettings(**settings))
        evaluator = recording_evaluator(figures)
        context = make_context(sphere, seed=seed, settings=groups, evaluator=evaluator)
        T = transform(np.broadcast_to(np.eye(3), (len(places), 3, 3)), np.array(places, float))
        it = StartTournament(context, Neighbourhood(context))
        it.consider(oracle.make_attempts(T, epsilon))
        return it, context

    return make


def along_x(n):
    return np.stack([np.arange(n), np.zeros(n), np.zeros(n)], axis=1)


def turns_of(context):
    """Which start each turn was about: they lie 1 m apart along x."""
    return [int(np.round(np.median(P[:, 0, 3]))) for P, _ in context.evaluator.attempts]


def test_without_a_grasp_there_is_nothing_to_do(tournament):
    it, context = tournament(along_x(3), [-1.0, 0.0, -1.0])
    assert not it.step()
    assert context.evaluator.n_attempts == 0


def test_the_better_half_goes_on_for_twice_as_long(tournament):
    """Figures that grow with x: of 8 starts the best one gets 8 turns, the worst four 1."""
    it, context = tournament(
        along_x(8),
        np.full(8, 0.01),
        figures=lambda T, s: 0.1 + 0.1 * np.round(T[:, 0, 3]),
        samples=3,
        tournament_rungs=4,
    )
    while it.step():
        pass
    count = np.bincount(turns_of(context), minlength=8)
    assert it.n_starts == 8
    # Whoever got on was among the better half of those before it; asynchronous, so that an
    # early one may have got on that is not of the better half in the end.
    assert count[7] == 8
    assert 4 <= np.sum(count >= 2) <= 6
    assert 2 <= np.sum(count >= 4) <= 4
    assert np.all(np.isin(count, [1, 2, 4, 8]))


def test_a_run_goes_on_from_the_best_it_has_found(tournament):
    it, context = tournament(
        along_x(1), [0.01], figures=lambda T, s: 0.5 + T[:, 1, 3], samples=6, tournament_rungs=1
    )
    it.step()
    assert not it.step(), "one rung, one start: one turn"
    # Two starts, so that the better of them is promoted.
    it, context = tournament(
        along_x(2), [0.01] * 2, figures=lambda T, s: 0.5 + T[:, 1, 3], samples=6
    )
    while it.step():
        pass
    turns = turns_of(context)
    assert len(turns) == 3
    first, last = turns.index(turns[-1]), 2
    poses, _ = context.evaluator.attempts[first]
    best = poses[np.argmax(poses[:, 1, 3])]
    start = along_x(2)[turns[-1]]
    again, _ = context.evaluator.attempts[last]
    # Small steps abound: the nearest neighbour of the second turn lies at where the first got to.
    reach = np.linalg.norm(again[:, :3, 3] - best[:3, 3], axis=1).min()
    assert reach < np.linalg.norm(again[:, :3, 3] - start, axis=1).min()


def test_nobody_starts_near_where_another_one_did(tournament):
    places = np.concatenate([along_x(5), along_x(5) + np.array([0.0, 0.01, 0.0])])
    it, context = tournament(
        places, np.full(10, 0.1), figures=lambda T, s: np.full(len(T), -1.0), samples=2
    )
    while it.step():
        pass
    assert it.n_starts == 5
    assert set(turns_of(context)) == set(range(5))
    # Nor does it when it comes later.
    it.consider(context.evaluator.attempt(np.stack([np.eye(4)] * 3), np.zeros((3, 1))))
    assert not it.step()


def test_a_pool_of_taken_places_does_not_hold_up_a_step(tournament):
    places = np.concatenate([np.zeros((1000, 3)), [[1.0, 0.0, 0.0]]])
    it, context = tournament(
        places, np.full(1001, 0.1), figures=lambda T, s: np.full(len(T), -1.0), samples=1
    )
    assert it.step()
    before, idle = len(it._objective), 0
    while it.n_starts < 2:
        idle += not it.step()
        assert len(it._objective) >= before - 30 * (idle + 1)
        assert idle < 40
    assert idle > 1
    assert 1.0 in np.round([P[0, 0, 3] for P, _ in context.evaluator.attempts])


def test_good_grasps_start_sooner(tournament):
    """Chance is proportional to the objective: 0.3 against 0.1, over 200 draws of the first."""
    first = []
    for seed in range(200):
        it, context = tournament(along_x(2), [0.1, 0.3], seed=seed, samples=1)
        it.step()
        first += turns_of(context)
    assert np.mean(first) == pytest.approx(0.75, abs=0.1)


def test_the_pool_stays_within_bounds(tournament, oracle):
    it, _ = tournament(along_x(4), np.full(4, 0.5))
    T = transform(
        np.broadcast_to(np.eye(3), (2500, 3, 3)), np.random.default_rng(0).random((2500, 3))
    )
    for k in range(5):
        it.consider(oracle.make_attempts(T, np.full(2500, 0.01 * (k + 1))))
    assert len(it._objective) <= 6000
    # The good ones are still there.
    assert_allclose(np.sort(it._objective)[-4:], 0.5)


def test_it_finds_the_one_start_that_leads_somewhere(tournament):
    """On the slope of a hill, a little less good than a hundred others that lead nowhere."""
    places = along_x(101)
    epsilon = np.full(101, 0.05)
    epsilon[60] = 0.04

    def figures(T, spread):
        offset = T[:, :3, 3] - [60.0, 0.05, 0.0]
        hill = 0.5 - 8.0 * np.linalg.norm(offset, axis=1)
        return np.where(hill > 0.0, hill, 0.05)

    found = []
    for seed in range(10):
        it, context = tournament(places, epsilon, figures=figures, seed=seed)
        while it.step():
            pass
        found.append(context.archive.best_epsilon)
        assert len(context.evaluator.attempts) < 101 * 4
        if found[-1] > 0.4:
            best = context.archive.best(1)[0]
            assert best.T_object_palm[0, 3] == pytest.approx(60.0, abs=0.02)
    # Who is drawn among the last ones finds the rungs full.
    assert np.sum(np.array(found) > 0.4) >= 7
