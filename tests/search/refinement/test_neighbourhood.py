"""Neighbours of a grasp: how they are drawn, tried, and how far apart grasps are."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.search.refinement.neighbourhood import Neighbourhood
from gpis_grasp_planner.search.settings import RefinementSettings


@pytest.fixture
def neighbours(sphere, make_context, recording_evaluator, rng):
    """A neighbourhood with settings of one's choice: (it, its context, a pose)."""

    def make(figures=None, **settings):
        groups = PlannerSettings(refinement=RefinementSettings(**settings))
        context = make_context(sphere, settings=groups, evaluator=recording_evaluator(figures))
        T = transform(Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.1, 0.1, 3))
        return Neighbourhood(context), context, T

    return make


@pytest.fixture(scope="session")
def face_height(planner):
    palm = planner.hand.link_names.index(planner.hand.palm_link)
    return max(p.vertices[:, 2].max() for p in planner.hand.link_collision[palm])


def moved(T_start, T, face_height):
    """Shift of the face's middle in the palm's axes (n, 3), and turn vectors (n, 3)."""

    def face(P):
        return P[..., :3, 3] + face_height * P[..., :3, 2]

    shift = (face(T) - face(T_start)) @ T_start[:3, :3]
    return shift, Rotation.from_matrix(T_start[:3, :3].T @ T[:, :3, :3]).as_rotvec()


def test_neighbours_move_about_the_palms_face(neighbours, face_height, rng):
    neighbourhood, _, T = neighbours(samples=1000)
    drawn, _ = neighbourhood.draw(T, np.ones(1), rng)
    shift, turn = moved(T, drawn, face_height)
    shifted = np.linalg.norm(shift, axis=1) > 1e-9
    turned = np.linalg.norm(turn, axis=1) > 1e-9
    # A third moves in place only, a third turns only, and a third does both.
    assert np.all(shifted | turned)
    for what in (shifted & ~turned, turned & ~shifted, shifted & turned):
        assert np.mean(what) == pytest.approx(1.0 / 3.0, abs=0.06)
    assert_allclose(np.linalg.det(drawn[:, :3, :3]), 1.0, rtol=1e-12)


def test_steps_are_drawn_from_the_whole_range_of_scales(neighbours, face_height, rng):
    neighbourhood, _, T = neighbours(
        samples=1000, step_min=0.01, step_translation_m=0.02, step_rotation_deg=10.0
    )
    drawn, _ = neighbourhood.draw(T, np.ones(1), rng)
    shift, turn = moved(T, drawn, face_height)
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
def test_spreads_stay_within_their_limits(neighbours, spread, rng):
    neighbourhood, _, T = neighbours(samples=300, step_spread_deg=90.0)
    _, drawn = neighbourhood.draw(T, np.array([spread]), rng)
    assert np.all((drawn >= 0.0) & (drawn <= np.pi))
    assert np.mean(drawn == spread) == pytest.approx(0.5, abs=0.1)


def test_an_attempt_answers_the_best_of_its_neighbours_and_keeps_all(neighbours):
    neighbourhood, context, T = neighbours(
        figures=lambda T, s: 0.3 + T[:, 0, 3] + 0.01 * s[:, 0], samples=9
    )
    T_best, spread, objective = neighbourhood.attempt(T, np.ones(1))
    [(poses, spreads)] = context.evaluator.attempts
    figures = 0.3 + poses[:, 0, 3] + 0.01 * spreads[:, 0]
    best = int(np.argmax(figures))
    assert_allclose(T_best, poses[best], atol=0.0)
    assert spread == spreads[best]
    assert objective == figures[best]
    assert len(context.archive) == 9


def test_distances_are_counted_in_largest_steps(neighbours, face_height):
    s = {"step_translation_m": 0.02, "step_rotation_deg": 15.0, "step_spread_deg": 25.0}
    neighbourhood, _, T = neighbours(**s)
    along, about = np.array([0.0, 0.03, 0.0]), Rotation.from_rotvec([0.0, 0.0, np.deg2rad(30.0)])
    shifted = T.copy()
    shifted[:3, 3] += along
    turned = T.copy()
    turned[:3, :3] = T[:3, :3] @ about.as_matrix()
    tilted = T.copy()
    tilted[:3, :3] = T[:3, :3] @ Rotation.from_rotvec([np.deg2rad(15.0), 0.0, 0.0]).as_matrix()
    others = np.stack([T, shifted, turned, T, tilted])
    spreads = 1.0 + np.deg2rad([[0.0], [0.0], [0.0], [-50.0], [0.0]])
    # The tilt about the flange carries the palm's face along a chord.
    chord = 2.0 * face_height * np.sin(np.deg2rad(7.5)) / 0.02
    expected = [0.0, 1.5, 2.0, 2.0, np.hypot(1.0, chord)]
    assert_allclose(
        neighbourhood.steps_between(others, spreads, T, np.ones(1)), expected, atol=1e-6
    )


def test_a_step_of_nothing_makes_everything_else_far(neighbours):
    neighbourhood, _, T = neighbours(step_translation_m=0.0)
    other = T.copy()
    other[0, 3] += 1e-6
    distance = neighbourhood.steps_between(np.stack([T, other]), np.ones((2, 1)), T, np.ones(1))
    assert distance[0] < 1e-3
    assert distance[1] > 100.0
