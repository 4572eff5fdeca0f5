"""The list's grasps refined in turn: who has a turn, and when."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.search.refinement.list_refinement import ListRefinement
from gpis_grasp_planner.search.refinement.neighbourhood import Neighbourhood
from gpis_grasp_planner.search.settings import RefinementSettings


@pytest.fixture
def refine(sphere, make_context, recording_evaluator, oracle, rng):
    """A refinement over n far-apart grasps with falling figures: (it, its context, poses)."""

    def make(n=3, figures=None, **settings):
        groups = PlannerSettings(refinement=RefinementSettings(**settings))
        context = make_context(sphere, settings=groups, evaluator=recording_evaluator(figures))
        shift = np.zeros((n, 3))
        shift[:, 0] = np.arange(n)
        T = transform(Rotation.random(n, rng=rng).as_matrix(), shift)
        context.archive.add(oracle.make_attempts(T, 0.2 / (1.0 + np.arange(n))))
        return ListRefinement(context, Neighbourhood(context)), context, T

    return make


def turns_of(context):
    """Which grasp each turn was about: they lie 1 m apart along x."""
    return [int(np.round(np.median(P[:, 0, 3]))) for P, _ in context.evaluator.attempts]


def test_without_a_grasp_there_is_no_turn(sphere, make_context, recording_evaluator):
    context = make_context(sphere, evaluator=recording_evaluator())
    assert not ListRefinement(context, Neighbourhood(context)).step()
    assert context.evaluator.n_attempts == 0


def test_grasps_take_turns_best_first(refine):
    refinement, context, _ = refine(
        3, figures=lambda T, s: np.full(len(T), -1.0), samples=5, n_grasps=3
    )
    for _ in range(7):
        assert refinement.step()
    assert turns_of(context) == [0, 1, 2, 0, 1, 2, 0]
    assert [len(P) for P, _ in context.evaluator.attempts] == [5] * 7


def test_n_grasps_limits_the_round(refine):
    refinement, context, _ = refine(
        4, figures=lambda T, s: np.full(len(T), -1.0), samples=3, n_grasps=2
    )
    for _ in range(4):
        refinement.step()
    assert turns_of(context) == [0, 1, 0, 1]


def test_who_no_longer_improves_sits_out(refine):
    """Grasp 0 never gets better; grasps about x = 1 do at every turn, each a new one."""
    tried = []

    def figures(T, spread):
        if T[0, 0, 3] < 0.5:
            return np.full(len(T), -1.0)
        tried.append(len(T))
        return np.full(len(T), 0.1 + 1e-3 * len(tried))

    refinement, context, _ = refine(2, figures=figures, samples=4, n_grasps=2)
    for _ in range(70):
        refinement.step()
    turns = np.array(turns_of(context))
    # Rounds in which the first has its turn: it sits out 1, 3, 7, 15 and 31 rounds between.
    rounds = np.cumsum(turns == 1)[turns == 0]
    assert list(np.diff(rounds)) == [2, 4, 8, 16, 32]
    assert np.mean(turns == 0) < 0.1


def test_what_improves_is_refined_next(refine):
    # The farther along y the better: the next round starts from the best found so far.
    refinement, context, _ = refine(1, figures=lambda T, s: 0.3 + T[:, 1, 3], samples=20)
    best = context.archive.best_epsilon
    for _ in range(80):
        refinement.step()
        assert context.archive.best_epsilon >= best
        best = context.archive.best_epsilon
    assert best > 0.35


def test_the_first_grasp_is_never_lost(refine):
    refinement, context, T = refine(1, figures=lambda T, s: np.full(len(T), 0.05), samples=50)
    for _ in range(20):
        refinement.step()
    best = context.archive.best(1)[0]
    assert best.epsilon == 0.2
    assert_allclose(best.T_object_palm, T[0], atol=0.0)
