"""Epsilon of a hull of forces against bodies with known insphere and against Qhull."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from gpis_grasp_planner.quality.wrench_space import tangents
from gpis_grasp_planner.scene.force_hull import force_epsilon

OCTAHEDRON = np.concatenate([np.eye(3), -np.eye(3)])
CUBE = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
TETRAHEDRON = CUBE[[0, 3, 5, 6]]


@pytest.mark.parametrize(
    ("points", "radius"),
    [
        (OCTAHEDRON, 1.0 / np.sqrt(3.0)),
        (2.5 * OCTAHEDRON, 2.5 / np.sqrt(3.0)),
        (CUBE, 1.0),
        (CUBE + np.array([0.3, -0.1, 0.2]), 0.7),
        (TETRAHEDRON, 1.0 / np.sqrt(3.0)),
        (np.concatenate([CUBE, 0.5 * CUBE, np.zeros((5, 3)), CUBE]), 1.0),
    ],
)
def test_bodies_with_known_insphere(points, radius):
    assert force_epsilon(points, len(points)) == pytest.approx(radius, abs=1e-12)


@pytest.mark.parametrize(
    "points",
    [
        CUBE + np.array([1.5, 0.0, 0.0]),
        CUBE + np.array([1.0, 0.0, 0.0]),
        OCTAHEDRON[:5],
        CUBE * [1.0, 1.0, 0.0],
        CUBE * [1.0, 0.0, 0.0],
        np.zeros((8, 3)),
        TETRAHEDRON[:3],
        OCTAHEDRON + np.array([0.4, 0.4, 0.4]),
    ],
)
def test_no_ball_where_the_origin_is_not_strictly_inside(points):
    assert force_epsilon(np.ascontiguousarray(points, dtype=float), len(points)) == -1.0


def test_only_the_first_n_points_count():
    points = np.concatenate([OCTAHEDRON, 10.0 * CUBE])
    assert force_epsilon(points, 6) == pytest.approx(1.0 / np.sqrt(3.0))


def test_agrees_with_qhull_on_random_clouds(rng):
    closed = 0
    for _ in range(600):
        points = rng.normal(size=(rng.integers(4, 120), 3)) * rng.uniform(0.1, 2.0, 3)
        points += rng.uniform(0.0, 1.0) * rng.normal(size=3)
        nearest = -ConvexHull(points).equations[:, -1].max()
        expected = nearest if nearest > 0.0 else -1.0
        assert force_epsilon(points, len(points)) == pytest.approx(expected, abs=1e-8)
        closed += expected > 0.0
    assert closed > 200


def test_agrees_with_qhull_on_friction_pyramids(rng):
    angle = np.pi / 4 * np.arange(8)
    closed = 0
    for _ in range(600):
        n = rng.normal(size=(rng.integers(2, 20), 3))
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        a, b = tangents(n)
        ring = np.cos(angle)[:, None] * a[:, None] + np.sin(angle)[:, None] * b[:, None]
        scale = rng.uniform(0.05, 2.0, len(n))[:, None, None]
        points = np.ascontiguousarray((scale * (n[:, None] + 0.2 * ring)).reshape(-1, 3))
        nearest = -ConvexHull(points).equations[:, -1].max()
        expected = nearest if nearest > 0.0 else -1.0
        assert force_epsilon(points, len(points)) == pytest.approx(expected, abs=1e-7)
        closed += expected > 0.0
    assert closed > 200
