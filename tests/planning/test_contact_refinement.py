"""The second stage in its improved form: neighbours of good grasps, closed anew."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.planning.contact_refinement import ContactRefinement
from gpis_grasp_planner.planning.search_settings import RefinementSettings
from gpis_grasp_planner.planning.settings import PlannerSettings


@pytest.fixture
def refine(sphere, make_context, recording_evaluator, oracle, rng):
    """A refinement over n far-apart grasps with falling figures: (it, evaluator, poses)."""

    def make(n=3, spread=1.0, figures=None, **settings):
        groups = PlannerSettings(refinement=RefinementSettings(**settings))
        evaluator = recording_evaluator(figures)
        context = make_context(sphere, settings=groups, evaluator=evaluator)
        shift = np.zeros((n, 3))
        shift[:, 0] = np.arange(n)
        T = transform(Rotation.random(n, rng=rng).as_matrix(), shift)
        attempts = oracle.make_attempts(T, 0.2 / (1.0 + np.arange(n)))
        attempts.spread[:] = spread
        context.archive.add(attempts)
        return ContactRefinement(context), evaluator, T

    return make


def moved(T_start, T, face_height):
    """Shift of the face's middle in the palm's axes (n, 3), and turn vectors (n, 3)."""

    def face(P):
        return P[..., :3, 3] + face_height * P[..., :3, 2]

    shift = (face(T) - face(T_start)) @ T_start[:3, :3]
    return shift, Rotation.from_matrix(T_start[:3, :3].T @ T[:, :3, :3]).as_rotvec()


def face_height(planner):
    palm = planner.hand.link_names.index(planner.hand.palm_link)
    return max(p.vertices[:, 2].max() for p in planner.hand.link_collision[palm])


def test_nothing_to_refine_is_nothing_done(sphere, make_context, recording_evaluator):
    evaluator = recording_evaluator()
    refinement = ContactRefinement(make_context(sphere, evaluator=evaluator))
    assert not refinement.ready
    refinement.step()
    assert evaluator.n_attempts == 0


def test_grasps_take_turns_best_first(refine):
    refinement, evaluator, _ = refine(
        3, figures=lambda T, s: np.full(len(T), -1.0), samples=5, n_grasps=3
    )
    assert refinement.ready
    for _ in range(7):
        refinement.step()
    turns = [int(np.round(np.median(P[:, 0, 3]))) for P, _ in evaluator.attempts]
    assert turns == [0, 1, 2, 0, 1, 2, 0]
    assert [len(P) for P, _ in evaluator.attempts] == [5] * 7


def test_n_grasps_limits_the_round(refine):
    refinement, evaluator, _ = refine(
        4, figures=lambda T, s: np.full(len(T), -1.0), samples=3, n_grasps=2
    )
    for _ in range(4):
        refinement.step()
    assert [int(np.round(np.median(P[:, 0, 3]))) for P, _ in evaluator.attempts] == [0, 1, 0, 1]


def test_neighbours_move_about_the_palms_face(refine, planner):
    refinement, evaluator, T = refine(1, samples=1000)
    refinement.step()
    [(neighbours, _)] = evaluator.attempts
    shift, turn = moved(T[0], neighbours, face_height(planner))
    shifted = np.linalg.norm(shift, axis=1) > 1e-9
    turned = np.linalg.norm(turn, axis=1) > 1e-9
    # A third moves in place only, a third turns only, and a third does both.
    assert np.all(shifted | turned)
    for what in (shifted & ~turned, turned & ~shifted, shifted & turned):
        assert np.mean(what) == pytest.approx(1.0 / 3.0, abs=0.06)
    assert_allclose(np.linalg.det(neighbours[:, :3, :3]), 1.0, rtol=1e-12)


def test_steps_are_drawn_from_the_whole_range_of_scales(refine, planner):
    s = {"step_min": 0.01, "step_translation_m": 0.02, "step_rotation_deg": 10.0}
    refinement, evaluator, T = refine(1, samples=1000, **s)
    refinement.step()
    shift, turn = moved(T[0], evaluator.attempts[0][0], face_height(planner))
    for step, largest in ((shift, 0.02), (turn, np.deg2rad(10.0))):
        length = np.linalg.norm(step, axis=1)
        length = length[length > 1e-9]
        # Log-uniform scales between 1 % and all of the largest step: median 10 % of it.
        assert np.median(length) == pytest.approx(0.1 * 1.54 * largest, rel=0.25)
        assert length.min() < 0.03 * largest
        assert length.max() > largest
        assert length.max() < 5.0 * largest
        # No direction is preferred.
        assert np.all(np.abs(np.mean(step, axis=0)) < 0.1 * largest)


@pytest.mark.parametrize("spread", [0.0, np.pi])
def test_spreads_stay_within_their_limits(refine, spread):
    refinement, evaluator, _ = refine(1, spread=spread, samples=300, step_spread_deg=90.0)
    refinement.step()
    drawn = evaluator.attempts[0][1]
    assert np.all((drawn >= 0.0) & (drawn <= np.pi))
    assert np.mean(drawn == spread) == pytest.approx(0.5, abs=0.1)


def test_what_improves_is_refined_next(refine):
    # The farther along y the better: the queue's next round starts from the best found so far.
    refinement, _, _ = refine(1, figures=lambda T, s: 0.3 + T[:, 1, 3], samples=20)
    archive = refinement._context.archive
    best = archive.best_epsilon
    for _ in range(25):
        refinement.step()
        assert archive.best_epsilon >= best
        best = archive.best_epsilon
    assert best > 0.35


def test_the_first_grasp_is_never_lost(refine):
    refinement, _, T = refine(1, figures=lambda T, s: np.full(len(T), 0.05), samples=50)
    for _ in range(20):
        refinement.step()
    best = refinement._context.archive.best(1)[0]
    assert best.epsilon == 0.2
    assert_allclose(best.T_object_palm, T[0], atol=0.0)


def test_a_real_grasp_gets_better(make_context, sphere):
    context = make_context(sphere, seed=3)
    T = np.eye(4)
    T[:3, :3] = np.diag([1.0, -1.0, -1.0])
    T[2, 3] = 0.035 + context.T_palm_face[2, 3] + 0.04
    context.archive.add(context.evaluator.attempt(T[None], np.array([np.pi / 3])))
    first = context.archive.best(1)[0].objective
    refinement = ContactRefinement(context)
    for _ in range(15):
        refinement.step()
    assert context.archive.best(1)[0].objective > 2.0 * first
