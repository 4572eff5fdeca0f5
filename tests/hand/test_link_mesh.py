"""Hulls, and mass properties of solids with known answers."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.hand.link_mesh import (
    convex_hull,
    fewest_vertices,
    inertia_from_moments,
    solid_properties,
)

BOX = np.array([[x, y, z] for x in (-1, 1) for y in (-2, 2) for z in (-3, 3)]) * 0.5


def test_hull_drops_inner_points_and_looks_outwards():
    mesh = convex_hull(np.vstack([BOX, [[0, 0, 0], [0.1, 0.2, 0.3]]]))
    assert len(mesh.vertices) == 8
    assert (np.einsum("ij,ij->i", mesh.face_normals_outward, mesh.triangles[:, 0]) > 0).all()


def test_a_box_has_the_textbook_inertia_wherever_it_stands():
    a, b, c = 1.0, 2.0, 3.0
    R, shift = Rotation.from_euler("xyz", [0.4, -1.0, 2.0]).as_matrix(), np.array([3.0, -1.0, 5.0])
    volume, center, moments = solid_properties(convex_hull(BOX @ R.T + shift))
    assert volume == pytest.approx(6.0, rel=1e-12)
    np.testing.assert_allclose(center, shift, atol=1e-12)
    inertia = inertia_from_moments(moments - volume * np.outer(center, center))
    expected = 6.0 / 12.0 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b])
    np.testing.assert_allclose(inertia, R @ expected @ R.T, atol=1e-9)


def test_few_vertices_span_the_same_body(rng):
    points = rng.normal(size=(400, 3)) * [0.02, 0.03, 0.05]
    tolerance = 5e-4
    chosen = fewest_vertices(points, tolerance)
    assert {tuple(p) for p in chosen} <= {tuple(p) for p in points}
    planes = ConvexHull(chosen).equations
    assert (points @ planes[:, :3].T + planes[:, 3]).max() <= tolerance
    corners = ConvexHull(points).vertices
    assert len(chosen) < len(corners)
    # without a tolerance every corner is needed
    every = fewest_vertices(points, 1e-12)
    assert sorted(map(tuple, every)) == sorted(map(tuple, points[corners]))


def test_a_limit_takes_many_points_at_a_time(rng, monkeypatch):
    """Of a round body of thousands of corners: few hulls are grown, and none is far from it."""
    grown = []

    class Counted(ConvexHull):
        def add_points(self, points, restart=False):
            grown.append(len(points))
            super().add_points(points, restart)

    monkeypatch.setattr("scipy.spatial.ConvexHull", Counted)
    points = rng.normal(size=(4000, 3))
    points *= 0.02 / np.linalg.norm(points, axis=1, keepdims=True)
    chosen = fewest_vertices(points, 1e-6, 256)
    assert len(chosen) == 256
    assert len({tuple(p) for p in chosen}) == 256
    assert len(grown) < 30
    planes = ConvexHull(chosen).equations
    assert (points @ planes[:, :3].T + planes[:, 3]).max() < 6e-4  # 256 even caps: 3e-4
