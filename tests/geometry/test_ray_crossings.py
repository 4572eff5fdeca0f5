"""Winding numbers by rays against exact solid angles, and which side of a patch is outside."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.ray_crossings import crossing_numbers, outward_votes
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.geometry.winding import winding_numbers


def mesh_of(solid: trimesh.Trimesh) -> TriangleMesh:
    return TriangleMesh(np.asarray(solid.vertices), np.asarray(solid.faces, dtype=np.int32))


@pytest.fixture(scope="module")
def torus() -> TriangleMesh:
    return mesh_of(trimesh.creation.torus(major_radius=0.04, minor_radius=0.012))


def test_crossings_are_the_winding_numbers_of_solid_angles(torus, rng):
    sphere = mesh_of(trimesh.creation.icosphere(subdivisions=2, radius=0.03))
    inverted = TriangleMesh(
        np.vstack([torus.vertices, sphere.vertices + np.array([0.04, 0.0, 0.0])]),
        np.vstack([torus.faces, sphere.faces[:, ::-1] + len(torus.vertices)]),
    )
    points = rng.uniform(-0.06, 0.08, (400, 3))
    for mesh in (torus, inverted):
        expected = np.rint(winding_numbers(mesh.triangles, points))
        np.testing.assert_array_equal(crossing_numbers(TriangleTree.of(mesh), points), expected)
    assert {-1, 0, 1} == set(expected)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_votes_tell_the_side_of_every_face_whatever_way_the_others_look(torus, share, rng):
    turned = rng.random(len(torus.faces)) < share
    faces = np.where(turned[:, None], torus.faces[:, ::-1], torus.faces)
    tree = TriangleTree.of(TriangleMesh(torus.vertices, faces))
    votes = outward_votes(tree, tree.faces, len(faces))
    np.testing.assert_array_equal(votes, np.where(turned, -1.0, 1.0))


def test_a_flat_sheet_has_no_side():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    mesh = TriangleMesh(corners, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32))
    votes = outward_votes(TriangleTree.of(mesh), np.zeros(2, dtype=np.int64), 1)
    assert votes == pytest.approx(0.0)
