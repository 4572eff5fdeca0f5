"""Samples lie on the mesh, keep their distance and cover it; both sides of a wall are sampled."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.surface.sampling import sample_surface

SIZE = np.array([0.12, 0.08, 0.05])


def test_samples_lie_on_the_faces_with_their_normals(shapes, seed):
    points, normals = sample_surface(shapes.box_mesh(SIZE), 1000, seed)
    scaled = points / (0.5 * SIZE)
    axis = np.abs(scaled).argmax(axis=1)
    rows = np.arange(len(points))
    np.testing.assert_allclose(np.abs(scaled[rows, axis]), 1.0, atol=1e-12)
    expected = np.zeros_like(points)
    expected[rows, axis] = np.sign(scaled[rows, axis])
    np.testing.assert_allclose(normals, expected, atol=1e-12)


@pytest.mark.parametrize("n", [100, 1000, 5000])
def test_number_spacing_and_cover(shapes, seed, n):
    mesh = shapes.box_mesh(SIZE)
    points, _ = sample_surface(mesh, n, seed)
    assert 0.9 * n < len(points) < 1.1 * n
    even = np.sqrt(mesh.face_areas.sum() / n)
    tree = cKDTree(points)
    assert tree.query(points, k=2)[0][:, 1].min() > 0.7 * even
    fresh, _ = sample_surface(mesh, 4 * n, seed + 1)
    assert tree.query(fresh)[0].max() < 1.6 * even


def test_the_two_sides_of_a_thin_wall_do_not_shadow_each_other(shapes, seed):
    mesh = shapes.hollow_box_mesh(SIZE, wall=0.001)
    points, _ = sample_surface(mesh, 1000, seed)
    inside = (np.abs(points) < 0.5 * SIZE - 0.0005).all(axis=1)
    areas = mesh.face_areas
    share = areas[12:].sum() / areas.sum()
    assert inside.mean() == pytest.approx(share, abs=0.05)


def test_equal_seeds_give_equal_samples(shapes, seed):
    mesh = shapes.box_mesh(SIZE)
    np.testing.assert_array_equal(
        sample_surface(mesh, 300, seed)[0], sample_surface(mesh, 300, seed)[0]
    )


def test_a_mesh_without_area_is_refused():
    mesh = TriangleMesh(np.zeros((3, 3)), np.array([[0, 1, 2]], dtype=np.int32))
    with pytest.raises(MeshError, match="surface of 0") as caught:
        sample_surface(mesh, 100, 0)
    assert caught.value.code == ErrorCode.MESH_DEGENERATE
