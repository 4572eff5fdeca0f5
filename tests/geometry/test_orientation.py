"""Faces of parts that fell apart at their sharp edges look outwards again, all of them."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.orientation import orient
from gpis_grasp_planner.geometry.topology import find_edges

PARTS = ("mug", "flange", "housing", "spur_gear")  # walls, bores, ribs, many small faces
GAPS = (0.0, 1e-8, 1e-6, 1e-4)


def split_at_sharp_edges(mesh: TriangleMesh, gap: float, angle_deg: float = 30.0):
    """Vertices, faces and the patch of each face; patches shrink to leave a gap (of the extent)."""
    edges, normals = find_edges(mesh.faces), mesh.face_normals_outward
    cosine = np.einsum("ij,ij->i", normals[edges.pairs[:, 0]], normals[edges.pairs[:, 1]])
    i, j = edges.pairs[cosine > np.cos(np.deg2rad(angle_deg))].T
    n = len(mesh.faces)
    count, patch = connected_components(coo_matrix((np.ones(len(i)), (i, j)), (n, n)), False)
    keys, index = np.unique(
        np.stack([np.repeat(patch, 3), mesh.faces.ravel()], axis=1), axis=0, return_inverse=True
    )
    vertices = mesh.vertices[keys[:, 1]]
    for p in range(count):
        mine = keys[:, 0] == p
        to_middle = vertices[mine].mean(axis=0) - vertices[mine]
        length = np.linalg.norm(to_middle, axis=1, keepdims=True).clip(min=1e-9)
        vertices[mine] += gap * mesh.extent.max() * to_middle / length
    return vertices, index.reshape(-1, 3).astype(np.int32), patch


def wrong_faces(vertices, found, right) -> int:
    """How many faces do not look the way they should."""

    def normals(faces):
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        return np.cross(b - a, c - a)

    return int((np.einsum("ij,ij->i", normals(found), normals(right)) <= 0.0).sum())


@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize("gap", GAPS)
def test_patches_of_real_parts_look_outwards_as_they_did(name, gap, rng):
    mesh = MeshCatalogue([default_catalogue_directory()]).load(name).mesh
    vertices, faces, patch = split_at_sharp_edges(mesh, gap)
    for share in (0.0, 0.3, 1.0):
        turned = (rng.random(patch.max() + 1) < share)[patch]
        found = orient(vertices, np.where(turned[:, None], faces[:, ::-1], faces))
        assert wrong_faces(vertices, found.faces, faces) == 0
        np.testing.assert_array_equal(found.turned, turned)
        assert not found.undecided.any()


def test_planar_faces_of_turned_boxes(write, rng):
    """A planar piece encloses no volume: only the others tell its side."""
    for R in Rotation.random(50, rng=rng).as_matrix():
        vertices, faces = write.box_arrays(rng.uniform(0.01, 0.2, 3))
        loose = np.concatenate([vertices[np.unique(faces[2 * k : 2 * k + 2])] for k in range(6)])
        index = np.concatenate(
            [
                4 * k + np.unique(faces[2 * k : 2 * k + 2], return_inverse=True)[1].reshape(-1, 3)
                for k in range(6)
            ]
        ).astype(np.int32)
        turned = np.repeat(rng.random(6) < 0.5, 2)
        given = np.where(turned[:, None], index[:, ::-1], index)
        found = orient(loose @ R.T, given)
        assert wrong_faces(loose @ R.T, found.faces, index) == 0


@pytest.mark.parametrize("inverted", [False, True])
def test_cavities_and_what_lies_in_them(inverted):
    """A ball in a cavity in a ball, beside another ball: the closed pieces keep their sides."""
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    v, f = np.asarray(sphere.vertices), np.asarray(sphere.faces, dtype=np.int32)
    vertices = np.vstack([0.1 * v, 0.05 * v, 0.02 * v, 0.03 * v + (0.2, 0.0, 0.0)])
    n = len(v)
    right = np.vstack([f, f[:, ::-1] + n, f + 2 * n, f + 3 * n])
    found = orient(vertices, right[:, ::-1] if inverted else right)
    np.testing.assert_array_equal(found.turned, inverted)
    assert wrong_faces(vertices, found.faces, right) == 0


def test_a_cavity_of_a_body_that_is_not_stitched_stays(write):
    vertices, faces, _ = split_at_sharp_edges(
        TriangleMesh(write.box_arrays()[0], write.box_arrays()[1].astype(np.int32)), 1e-4
    )
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.01)
    right = np.vstack([faces, np.asarray(ball.faces)[:, ::-1] + len(vertices)]).astype(np.int32)
    found = orient(np.vstack([vertices, ball.vertices]), right)
    assert not found.turned.any()


def test_a_sheet_is_left_as_it_is(rng):
    x, y = np.meshgrid(np.arange(12) * 0.01, np.arange(12) * 0.01, indexing="ij")
    vertices = np.stack([x, y, np.zeros((12, 12))], axis=-1).reshape(-1, 3)
    at = np.arange(144).reshape(12, 12)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    for given in (faces, faces[:, ::-1]):
        found = orient(vertices, given.astype(np.int32))
        assert found.undecided.all()
        np.testing.assert_array_equal(found.faces, given)
