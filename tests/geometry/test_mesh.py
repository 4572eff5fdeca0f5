"""TriangleMesh: known areas and normals, and a hash that follows the geometry and nothing else."""

import numpy as np
import pytest

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Friction, Part


@pytest.fixture
def box(write):
    vertices, faces = write.box_arrays((0.06, 0.05, 0.04), (0.01, 0.0, 0.0))
    return TriangleMesh(vertices, faces.astype(np.int32))


def test_box_has_its_areas_normals_and_bounds(box):
    assert box.face_areas.sum() == pytest.approx(2 * (0.06 * 0.05 + 0.05 * 0.04 + 0.06 * 0.04))
    middle = box.triangles.mean(axis=1) - [0.01, 0.0, 0.0]
    assert (np.einsum("ij,ij->i", box.face_normals_outward, middle) > 0.0).all()
    np.testing.assert_array_equal(np.sort(np.abs(box.face_normals_outward)), [[0, 0, 1]] * 12)
    np.testing.assert_allclose(box.extent, [0.06, 0.05, 0.04])
    assert box.diagonal == pytest.approx(np.sqrt(0.06**2 + 0.05**2 + 0.04**2))


def test_face_without_area_has_a_zero_normal():
    mesh = TriangleMesh(np.eye(3), np.array([[0, 1, 2], [0, 0, 1]], dtype=np.int32))
    np.testing.assert_allclose(mesh.face_normals_outward[0], np.full(3, 3**-0.5))
    np.testing.assert_array_equal(mesh.face_normals_outward[1], 0.0)
    assert mesh.face_areas[1] == 0.0


def test_hash_depends_on_values_alone(box):
    def rebuilt(vertices, faces):
        return TriangleMesh(vertices, faces).content_hash

    same = rebuilt(np.asfortranarray(box.vertices), box.faces.astype(np.int64))
    assert same == box.content_hash
    moved = box.vertices.copy()
    moved[0, 0] = np.nextafter(moved[0, 0], 1.0)
    assert rebuilt(moved, box.faces) != box.content_hash
    assert rebuilt(box.vertices, box.faces[::-1]) != box.content_hash
    assert len(box.content_hash) == 64


def test_max_radius_is_the_farthest_corner_from_the_center_of_mass(box):
    part = Part("box", box, np.array([0.01, 0.0, 0.0]), 0.1, 1.2e-4, True, Friction(0.4, 0.3))
    assert part.max_radius == pytest.approx(0.5 * box.diagonal)
