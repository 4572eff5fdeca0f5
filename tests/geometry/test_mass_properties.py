"""Volumes and centres against closed forms, anywhere and any way round."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import QhullError
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.mass_properties import (
    fans_across_holes,
    hull,
    signed_volume,
    volume_and_center,
)
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.topology import find_edges


def test_tetrahedron():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])
    triangles = corners[[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]]
    volume, center = volume_and_center(triangles)
    assert volume == pytest.approx(1.0, rel=1e-14)
    np.testing.assert_allclose(center, corners.mean(axis=0), rtol=1e-14)
    assert signed_volume(triangles[:, ::-1]) == pytest.approx(-1.0, rel=1e-14)
    np.testing.assert_allclose(volume_and_center(triangles[:, ::-1])[1], center, rtol=1e-12)


def test_a_box_anywhere(write, rng):
    for R in Rotation.random(20, rng=rng).as_matrix():
        size, center = rng.uniform(0.01, 0.3, 3), rng.uniform(-100, 100, 3)
        vertices, faces = write.box_arrays(size)
        volume, found = volume_and_center((vertices @ R.T + center)[faces])
        assert volume == pytest.approx(np.prod(size), rel=1e-8)
        np.testing.assert_allclose(found, center, atol=1e-9)


def test_a_surface_without_volume_has_its_mean_as_centre(write):
    vertices, faces = write.box_arrays(center=(1, 2, 3))
    both = np.concatenate([vertices[faces], vertices[faces[:, ::-1]]])
    volume, center = volume_and_center(both)
    assert volume == pytest.approx(0.0, abs=1e-18)
    np.testing.assert_allclose(center, (1, 2, 3), atol=1e-9)


def test_hull_of_an_open_box_is_the_box_and_faces_outwards(write):
    vertices, faces = write.box_arrays(center=(0.1, 0, 0))
    found = hull(TriangleMesh(vertices, faces[2:].astype(np.int32)))
    volume, center = volume_and_center(found.triangles)
    assert volume == pytest.approx(np.prod(write.box_size), rel=1e-12)
    np.testing.assert_allclose(center, (0.1, 0, 0), atol=1e-12)
    away = found.triangles.mean(axis=1) - center
    assert (np.einsum("ij,ij->i", away, found.face_normals_outward) > 0).all()


def test_flat_points_have_no_hull(write):
    vertices, faces = write.box_arrays()
    vertices[:, 2] = 0.0
    with pytest.raises(QhullError):
        hull(TriangleMesh(vertices, faces.astype(np.int32)))


def test_fans_close_flat_holes_exactly_and_round_ones_nearly(write, rng):
    vertices, faces = write.box_arrays()
    for gone in ([0], [0, 1], [2, 3], [7]):
        kept = np.delete(faces, gone, axis=0)
        fans = fans_across_holes(vertices, find_edges(kept.astype(np.int32)))
        closed = np.concatenate([vertices[kept], fans])
        for shift in (0.0, 1.0):
            assert signed_volume(closed + shift) == pytest.approx(np.prod(write.box_size), rel=1e-9)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    for _ in range(10):
        kept = np.delete(np.asarray(ball.faces), rng.integers(len(ball.faces), size=6), axis=0)
        fans = fans_across_holes(ball.vertices, find_edges(kept.astype(np.int32)))
        volume, center = volume_and_center(np.concatenate([ball.vertices[kept], fans]))
        assert volume == pytest.approx(ball.volume, rel=2e-3)
        np.testing.assert_allclose(center, 0.0, atol=1e-4)
