"""Distances of convex polytopes against another library's, and their symmetries."""

import coal
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.gjk import polytope_distance

# The reference stops at 1e-6 m.
REFERENCE_TOLERANCE = 2e-6


def distance(a, b, limit=1e30, guess=None):
    direction = np.zeros(3) if guess is None else np.array(guess, dtype=float)
    p, q = np.empty(3), np.empty(3)
    d = polytope_distance(np.ascontiguousarray(a), np.ascontiguousarray(b), limit, direction, p, q)
    return d, p, q, direction


def polytope(rng, n, size=0.03):
    points = rng.normal(size=(n, 3)) * size * rng.uniform(0.3, 1.0, size=3)
    return points[ConvexHull(points).vertices]


def coal_shape(points):
    vertices = coal.StdVec_Vec3s()
    for p in points:
        vertices.append(np.array(p))
    return coal.Convex.convexHull(vertices, False, "Qt")


def coal_distance(a, b):
    return coal.distance(
        coal_shape(a), coal.Transform3s(), coal_shape(b), coal.Transform3s(),
        coal.DistanceRequest(), coal.DistanceResult(),
    )  # fmt: skip


def pairs(rng, n):
    for _ in range(n):
        a, b = polytope(rng, rng.integers(8, 60)), polytope(rng, rng.integers(8, 60))
        yield a, b @ Rotation.random(rng=rng).as_matrix().T + rng.normal(size=3) * 0.06


def test_agrees_with_the_reference_and_names_its_nearest_points(rng):
    separate = overlapping = 0
    for a, b in pairs(rng, 300):
        d, p, q, v = distance(a, b)
        expected = coal_distance(a, b)
        if expected <= -REFERENCE_TOLERANCE:
            assert d == 0.0
            overlapping += 1
        elif expected >= REFERENCE_TOLERANCE:
            assert d == pytest.approx(expected, abs=REFERENCE_TOLERANCE)
            # a separating plane proves the distance: no reference needed
            n = v / np.linalg.norm(v)
            assert (a @ n).min() - (b @ n).max() == pytest.approx(d, rel=1e-8, abs=1e-12)
            np.testing.assert_allclose(p - q, v, atol=1e-12)
            assert np.linalg.norm(p - q) == pytest.approx(d, abs=1e-12)
            separate += 1
    assert min(separate, overlapping) > 50


def test_symmetric_and_indifferent_to_rigid_motion_and_to_the_first_guess(rng):
    for a, b in pairs(rng, 100):
        d = distance(a, b)[0]
        R, shift = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
        assert distance(b, a)[0] == pytest.approx(d, abs=1e-11)
        assert distance(a @ R.T + shift, b @ R.T + shift)[0] == pytest.approx(d, abs=1e-10)
        assert distance(a, b, guess=rng.normal(size=3))[0] == pytest.approx(d, abs=1e-11)


def test_known_answers():
    cube = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    far = cube + np.array([5.0, 0.0, 0.0])
    assert distance(cube, far)[0] == pytest.approx(3.0, abs=1e-15)  # face and face
    assert distance(cube, cube + np.array([4.0, 4.0, 0.0]))[0] == pytest.approx(
        8**0.5
    )  # edge and edge
    assert distance(cube, cube + np.array([3.0, 3.0, 3.0]))[0] == pytest.approx(3**0.5)  # corners
    triangle = np.array([[0.0, 0.0, 1.5], [9.0, 0.0, 1.5], [0.0, 9.0, 1.5]])
    assert distance(cube, triangle)[0] == pytest.approx(0.5)
    assert distance(cube, triangle - [0.0, 0.0, 1.0])[0] == 0.0  # cut
    assert distance(cube, 0.1 * cube)[0] == 0.0  # contained
    assert distance(cube, np.array([[0.0, 0.0, 3.0]]))[0] == pytest.approx(2.0)


@pytest.mark.parametrize("gap", [1e-3, 1e-5, 1e-7, 1e-8])
def test_small_gaps_are_seen_and_small_overlaps_are_zero(gap, rng):
    for a, b in pairs(rng, 60):
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        top, bottom = (a @ n).max(), (b @ n).min()
        away = b + n * (top - bottom + gap)
        # supports may be corners far apart: the plane is a lower bound, the corners an upper one
        d = distance(a, away)[0]
        assert d >= gap * (1 - 1e-6) - 1e-13
        corner = away - (away[np.argmin(away @ n)] - a[np.argmax(a @ n)]) + gap * n
        assert distance(a, corner)[0] == pytest.approx(gap, rel=1e-5)
        # pushed back into each other along the line of two inner points they must overlap
        assert distance(a, a + gap * n)[0] == 0.0


def test_beyond_the_limit_it_returns_a_lower_bound_above_the_limit(rng):
    for a, b in pairs(rng, 100):
        d = distance(a, b)[0]
        if d > 0.0:
            early = distance(a, b, limit=0.5 * d)[0]
            assert 0.5 * d < early <= d * (1 + 1e-12)
            assert distance(a, b, limit=1.001 * d)[0] == pytest.approx(d, abs=1e-11)
