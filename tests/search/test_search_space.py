"""The palm's search space: hyperspherical angles, the shell between two ellipsoids, features."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.search.search_space import (
    PalmSearchSpace,
    hyperspherical_from_quat,
    quat_from_hyperspherical,
)

BOUNDS = np.array([[-0.02, -0.05, 0.01], [0.06, 0.03, 0.11]])
CLEARANCE = 0.12
UNIT = st.floats(0.0, 1.0)
SIDE = st.floats(0.005, 0.4)


@pytest.fixture
def space():
    return PalmSearchSpace(BOUNDS, CLEARANCE)


def ellipsoid_radius(points, center, axes):
    """1 on the ellipsoid, smaller inside."""
    return np.linalg.norm((points - center) / axes, axis=-1)


def ellipsoids(bounds, clearance):
    """Centre, axes of E_1 and axes of E_2, from the box as the paper writes m_0 and m_1."""
    center = (bounds[0] + bounds[1]) / 2.0
    inner = (bounds[1] - bounds[0]) / 2.0
    return center, inner, inner + clearance


@pytest.mark.parametrize(
    ("angles", "quat_xyzw"),
    [
        ((0.0, 0.3, 0.7), (0.0, 0.0, 0.0, 1.0)),
        ((np.pi / 2, 0.0, 0.7), (1.0, 0.0, 0.0, 0.0)),
        ((np.pi / 2, np.pi / 2, 0.0), (0.0, 1.0, 0.0, 0.0)),
        ((np.pi / 2, np.pi / 2, np.pi / 2), (0.0, 0.0, 1.0, 0.0)),
        ((np.pi / 2, np.pi / 2, 3 * np.pi / 2), (0.0, 0.0, -1.0, 0.0)),
        ((np.pi, 0.3, 0.7), (0.0, 0.0, 0.0, -1.0)),
        ((np.pi / 4, 0.0, 0.0), (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))),
    ],
)
def test_known_angles_give_known_quaternions(angles, quat_xyzw):
    assert_allclose(quat_from_hyperspherical(np.array([angles]))[0], quat_xyzw, atol=1e-15)


def test_quaternions_come_back_with_their_sign(rng):
    quat = rng.standard_normal((2000, 4))
    quat /= np.linalg.norm(quat, axis=1, keepdims=True)
    assert_allclose(quat_from_hyperspherical(hyperspherical_from_quat(quat)), quat, atol=4e-15)


def test_angles_come_back(rng):
    # Away from the poles, where the later angles mean nothing.
    angles = rng.uniform([0.05, 0.05, 0.0], [np.pi - 0.05, np.pi - 0.05, 2 * np.pi], (2000, 3))
    assert_allclose(hyperspherical_from_quat(quat_from_hyperspherical(angles)), angles, atol=1e-12)


def test_angles_lie_in_the_papers_ranges(rng):
    quat = rng.standard_normal((5000, 4))
    # Exact axes and signed or tiny components are where a range ends.
    corners = np.array(np.meshgrid(*[[-1.0, -1e-20, -0.0, 0.0, 1e-20, 1.0]] * 4)).reshape(4, -1).T
    quat = np.concatenate([quat, corners[np.abs(corners).max(axis=1) == 1.0]])
    quat /= np.linalg.norm(quat, axis=1, keepdims=True)
    phi, psi, theta = hyperspherical_from_quat(quat).T
    assert np.all((phi >= 0.0) & (phi <= np.pi))
    assert np.all((psi >= 0.0) & (psi <= np.pi))
    assert np.all((theta >= 0.0) & (theta < 2.0 * np.pi))


@given(st.tuples(UNIT, UNIT, UNIT), st.tuples(SIDE, SIDE, SIDE), st.floats(0.001, 0.5))
def test_positions_lie_between_the_ellipsoids(unit, sides, clearance):
    low = np.array([-0.1, 0.2, 0.05])
    bounds = np.stack([low, low + sides])
    space = PalmSearchSpace(bounds, clearance)
    X = np.zeros((1, 6))
    X[0, :3] = np.array(unit) * [np.pi, 2.0 * np.pi, 1.0]
    center, inner, outer = ellipsoids(bounds, clearance)
    position = space.positions(X)
    assert ellipsoid_radius(position, center, inner)[0] >= 1.0 - 1e-9
    assert ellipsoid_radius(position, center, outer)[0] <= 1.0 + 1e-9


@pytest.mark.parametrize(("s", "which"), [(0.0, 1), (1.0, 2)])
def test_the_ends_of_r_lie_on_the_ellipsoids(space, rng, s, which):
    X = space.domain.sample(500, rng)
    X[:, 2] = s
    shape = ellipsoids(BOUNDS, CLEARANCE)
    assert_allclose(ellipsoid_radius(space.positions(X), shape[0], shape[which]), 1.0, rtol=1e-12)


def test_positions_are_the_papers_formula(space, rng):
    X = space.domain.sample(200, rng)
    (a_0, b_0, c_0), (a_1, b_1, c_1), (a_2, b_2, c_2) = ellipsoids(BOUNDS, CLEARANCE)
    for x, position in zip(X, space.positions(X), strict=True):
        theta, phi, s = x[:3]
        r_max = np.sqrt(
            1.0
            / (
                (a_1 * np.sin(theta) * np.cos(phi) / a_2) ** 2
                + (b_1 * np.sin(theta) * np.sin(phi) / b_2) ** 2
                + (c_1 * np.cos(theta) / c_2) ** 2
            )
        )
        r = 1.0 + s * (r_max - 1.0)
        expected = (
            a_0 + r * a_1 * np.sin(theta) * np.cos(phi),
            b_0 + r * b_1 * np.sin(theta) * np.sin(phi),
            c_0 + r * c_1 * np.cos(theta),
        )
        assert_allclose(position, expected, atol=1e-15)


def test_a_sheet_has_a_shell_as_well(rng):
    flat = np.array([[-0.1, -0.1, 0.0], [0.1, 0.1, 0.0]])
    space = PalmSearchSpace(flat, CLEARANCE)
    positions = space.positions(space.domain.sample(300, rng))
    outside = ellipsoid_radius(positions, np.zeros(3), np.array([0.1, 0.1, 1e-3]))
    assert np.all(np.isfinite(positions))
    assert np.all(outside >= 1.0 - 1e-9)


def test_poses_are_rigid_and_use_both_halves(space, rng):
    X = space.domain.sample(100, rng)
    T = space.poses(X)
    R = T[:, :3, :3]
    assert_allclose(R @ np.swapaxes(R, 1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-14)
    assert_allclose(np.linalg.det(R), 1.0, rtol=1e-13)
    assert_allclose(T[:, :3, 3], space.positions(X), atol=0.0)
    expected = Rotation.from_quat(quat_from_hyperspherical(X[:, 3:]))
    assert_allclose((expected.inv() * Rotation.from_matrix(R)).magnitude(), 0.0, atol=1e-7)


def test_the_domain_has_the_papers_ranges_and_wraps_the_full_circles(space):
    assert_allclose(space.domain.lower, 0.0)
    assert_allclose(
        space.domain.upper, [np.pi, 2 * np.pi, 1.0, np.pi, np.pi, 2 * np.pi], rtol=1e-15
    )
    assert space.domain.periodic.tolist() == [False, True, False, False, False, True]


def test_wrapped_coordinates_are_one_pose(space, rng):
    X = space.domain.sample(50, rng)
    around = X.copy()
    around[:, [1, 5]] += 2.0 * np.pi
    assert_allclose(space.poses(around), space.poses(X), atol=1e-14)


def test_features_of_coordinates_are_those_of_their_poses(space, rng):
    X = space.domain.sample(100, rng)
    features = space.domain.features(X)
    assert_allclose(space.features_of(space.poses(X), X[:, 6:]), features, atol=1e-14)
    assert_allclose(features[:, :3], space.positions(X), atol=0.0)
    assert_allclose(
        features[:, 3:].reshape(-1, 3, 3) * np.sqrt(2.0), space.poses(X)[:, :3, :3], atol=1e-14
    )


def test_the_model_sees_where_an_adaption_takes_the_pose(rng):
    def lifted(T):
        moved = T.copy()
        moved[:, 2, 3] += 1.0
        return moved

    plain, adapted = PalmSearchSpace(BOUNDS, CLEARANCE), PalmSearchSpace(BOUNDS, CLEARANCE, lifted)
    X = plain.domain.sample(20, rng)
    difference = adapted.domain.features(X) - plain.domain.features(X)
    assert_allclose(difference, np.tile(np.eye(12)[2], (20, 1)), atol=1e-14)
    assert_allclose(adapted.poses(X), plain.poses(X), atol=0.0)


def test_antipodal_quaternions_are_one_point_of_the_model(space, rng):
    X = space.domain.sample(50, rng)
    opposite = X.copy()
    opposite[:, 3:] = hyperspherical_from_quat(-quat_from_hyperspherical(X[:, 3:]))
    assert_allclose(space.domain.features(opposite), space.domain.features(X), atol=1e-13)


def test_latin_hypercube_fills_every_coordinate_evenly(space, rng):
    n = 40
    X = space.domain.sample(n, rng)
    unit = (X - space.domain.lower) / (space.domain.upper - space.domain.lower)
    strata = np.sort(np.floor(unit * n).astype(int), axis=0)
    assert np.array_equal(strata, np.tile(np.arange(n)[:, None], (1, 6)))


def test_spread_and_standoff_may_follow_the_palm(space, rng):
    eight = PalmSearchSpace(BOUNDS, CLEARANCE, posture_bounds=[[0.0, 0.0], [np.pi, 0.09]])
    X = eight.domain.sample(200, rng)
    assert_allclose(eight.domain.upper[6:], [np.pi, 0.09])
    assert X.shape == (200, 8)
    assert_allclose(eight.poses(X), space.poses(X[:, :6]), atol=0.0)
    features = eight.domain.features(X)
    assert_allclose(features[:, :12], space.domain.features(X[:, :6]), atol=0.0)
    assert_allclose(features[:, 12:], X[:, 6:], atol=0.0)
    assert eight.domain.distance.n_features == 14
    assert eight.domain.distance.definite


def test_places_are_those_of_the_coordinates_as_they_are_now():
    calls = []

    def adapt(T):
        calls.append(len(T))
        return T @ transform(np.eye(3), np.array([0.0, 0.0, 0.01]))

    space = PalmSearchSpace(BOUNDS, CLEARANCE, adapt)
    X = space.domain.sample(5, np.random.default_rng(0))
    first = space.places(X)
    assert_allclose(first, adapt(space.poses(X)))
    del calls[:]
    assert_allclose(space.domain.features(X)[:, :3], first[:, :3, 3])
    assert calls == []
    X[2, 2] = 1.0 - X[2, 2]
    assert_allclose(space.places(X), adapt(space.poses(X)))
    assert not np.allclose(space.places(X)[2], first[2])


def test_coordinates_are_the_inverse_of_poses(rng):
    space = PalmSearchSpace(np.array([[-0.03, -0.02, -0.05], [0.04, 0.02, 0.05]]), 0.12)
    X = space.domain.sample(200, rng)
    T = space.poses(X)
    np.testing.assert_allclose(space.poses(space.coordinates(T)), T, atol=1e-9)
    far = T.copy()
    far[:, :3, 3] = space.center + 10.0 * (T[:, :3, 3] - space.center)
    np.testing.assert_allclose(space.coordinates(far)[:, 2], 1.0)
    assert np.isfinite(space.coordinates(np.eye(4)[None])).all()
