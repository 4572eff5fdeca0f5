"""States to hands: poses by an independent rotation, postures by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from gpis_grasp_benchmark.rivals.hand_states import HandStates
from gpis_grasp_benchmark.rivals.settings import RivalSettings
from gpis_grasp_planner.search.context import palm_face_height


@pytest.fixture
def states(box, make_context):
    return HandStates(make_context(box))


def test_ranges_and_largest_steps_are_the_original_simulators(states):
    v = states.variables
    assert_allclose(v.lower, [-0.25, -0.25, -0.25, 0, -np.pi, 0, -4, -4])
    assert_allclose(v.upper, [0.25, 0.25, 0.35, np.pi, np.pi, np.pi, 4, 4])
    degrees = np.deg2rad([36, 90, 90])
    assert_allclose(v.largest_step, [0.15, 0.15, 0.15, *degrees, 2, 2])
    assert v.periodic.tolist() == [False] * 4 + [True] + [False] * 3


def test_the_largest_step_can_be_the_range(box, make_context):
    v = HandStates(make_context(box), RivalSettings(largest_step="range")).variables
    assert_allclose(v.largest_step, v.upper - v.lower)


def test_faces_are_turns_about_the_axis_placed_from_the_centre_of_mass(box, make_context, rng):
    center = np.array([0.3, -0.2, 0.1])
    part = dataclasses.replace(box, center_of_mass=center)
    states = HandStates(make_context(part))
    X = rng.uniform(states.variables.lower, states.variables.upper, (50, 8))
    T = states.faces(X)
    theta, phi, alpha = X[:, 3:6].T
    axis = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], 1)
    assert_allclose(
        T[:, :3, :3], Rotation.from_rotvec(alpha[:, None] * axis).as_matrix(), atol=1e-12
    )
    assert_allclose(T[:, :3, 3], center + X[:, :3], atol=1e-15)
    assert_allclose(T[:, 3], np.tile([0, 0, 0, 1.0], (50, 1)))


def test_every_rotation_has_a_state(states, rng):
    rotvec = Rotation.random(50, rng=rng).as_rotvec()
    alpha = np.linalg.norm(rotvec, axis=1)
    axis = rotvec / alpha[:, None]
    X = np.zeros((50, 8))
    X[:, 3] = np.arccos(axis[:, 2])
    X[:, 4] = np.arctan2(axis[:, 1], axis[:, 0])
    X[:, 5] = alpha
    assert not np.any(states.variables.lower > X)
    assert not np.any(states.variables.upper < X)
    expected = Rotation.from_rotvec(rotvec).as_matrix()
    assert_allclose(states.faces(X)[:, :3, :3], expected, atol=1e-9)


def test_the_palm_lies_behind_its_face(states, planner, rng):
    X = rng.uniform(states.variables.lower, states.variables.upper, (20, 8))
    T_face, (T_palm, _) = states.faces(X), states.hands(X)
    assert_allclose(T_palm[:, :3, :3], T_face[:, :3, :3], atol=1e-15)
    behind = T_face[:, :3, 3] - palm_face_height(planner.hand) * T_face[:, :3, 2]
    assert_allclose(T_palm[:, :3, 3], behind, atol=1e-15)


@pytest.mark.parametrize(
    ("amplitudes", "spread", "inner"),
    [
        ((0.0, 0.0), 1.13, 0.79),
        ((0.5, -0.25), 1.63, 0.54),
        ((-2.0, -1.0), 0.0, 0.0),
        ((4.0, 4.0), np.pi, np.deg2rad(140.0)),
    ],
)
def test_postures_of_known_amplitudes(states, planner, amplitudes, spread, inner):
    X = np.concatenate([np.zeros(6), amplitudes])[None]
    assert_allclose(states.motors(X), [[spread, inner, inner, inner]], atol=1e-12)
    joints = dict(zip(planner.hand.joint_names, states.hands(X)[1][0], strict=True))
    for name, angle in joints.items():
        expected = {"1": spread, "2": inner, "3": inner / 3.0}[name.split("_")[1][2]]
        assert angle == pytest.approx(expected, abs=1e-9), name
