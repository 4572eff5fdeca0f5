"""Nearest points through the tree against all triangles, one after the other."""

import numpy as np
import pytest
import trimesh

from gpis_grasp_planner.geometry import triangle_tree as module
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree, nearest_point


@pytest.fixture(scope="module")
def mesh():
    torus = trimesh.creation.torus(major_radius=0.04, minor_radius=0.012)
    return TriangleMesh(np.asarray(torus.vertices), np.asarray(torus.faces, dtype=np.int32))


@pytest.fixture(scope="module")
def tree(mesh):
    return TriangleTree.of(mesh)


def test_tree_holds_every_triangle_once_within_its_boxes(mesh, tree):
    def as_set(triangles):
        return {tuple(t.reshape(-1)) for t in triangles}

    assert as_set(tree.triangles) == as_set(mesh.triangles)
    assert len(tree.triangles) == len(mesh.faces)
    cross = np.cross(
        tree.triangles[:, 1] - tree.triangles[:, 0], tree.triangles[:, 2] - tree.triangles[:, 0]
    )
    np.testing.assert_allclose(
        tree.normals_outward, cross / np.linalg.norm(cross, axis=1, keepdims=True), atol=1e-12
    )
    owned = np.zeros(len(tree.triangles), dtype=int)

    def visit(node):
        a, b = tree.child[node]
        if a < 0:
            first = -1 - a
            owned[first : first + b] += 1
            assert 1 <= b <= 4
            rows = np.arange(first, first + b)
        else:
            rows = np.concatenate([visit(a), visit(b)])
        corners = tree.triangles[rows].reshape(-1, 3)
        np.testing.assert_array_equal(tree.lower[node], corners.min(axis=0))
        np.testing.assert_array_equal(tree.upper[node], corners.max(axis=0))
        return rows

    visit(0)
    np.testing.assert_array_equal(owned, 1)


def test_nearest_points_equal_brute_force(tree, rng):
    points = rng.uniform(-0.08, 0.08, size=(50, 3))
    nearest, distance, index = tree.nearest(points)
    for p, q, d, face in zip(points, nearest, distance, index, strict=True):
        all_nearest = trimesh.triangles.closest_point(
            tree.triangles, np.tile(p, (len(tree.triangles), 1))
        )
        expected = np.linalg.norm(all_nearest - p, axis=1)
        assert d == pytest.approx(expected.min(), abs=1e-14)
        assert np.linalg.norm(q - p) == pytest.approx(d, abs=1e-14)
        assert expected[face] == pytest.approx(d, abs=1e-14)
        np.testing.assert_allclose(q, all_nearest[face], atol=1e-13)


def test_limit_hides_what_is_beyond_and_nothing_else(tree, rng):
    q = np.empty(3)
    for p in rng.uniform(-0.08, 0.08, size=(50, 3)):
        _, distance, _ = tree.nearest(p[None])
        arrays = (tree.triangles, tree.lower, tree.upper, tree.child)
        found, face, _ = nearest_point(*p, distance[0] * 1.0001, *arrays, q)
        assert face >= 0
        assert found == distance[0]
        limit, face, _ = nearest_point(*p, distance[0] * 0.9999, *arrays, q)
        assert face == -1
        assert limit == pytest.approx(distance[0] * 0.9999)


def test_tells_face_from_edge_and_corner():
    mesh = TriangleMesh(np.eye(3), np.array([[0, 1, 2]], dtype=np.int32))
    tree = TriangleTree.of(mesh)
    arrays = (tree.triangles, tree.lower, tree.upper, tree.child)
    q = np.empty(3)
    distance, _, inside = nearest_point(1.0, 1.0, 1.0, 9.0, *arrays, q)
    assert inside
    assert distance == pytest.approx(2.0 / np.sqrt(3.0))
    np.testing.assert_allclose(q, 1.0 / 3.0)
    _, _, inside = nearest_point(2.0, 0.0, 0.0, 9.0, *arrays, q)
    assert not inside
    np.testing.assert_allclose(q, [1.0, 0.0, 0.0])
    _, _, inside = nearest_point(1.0, 1.0, 0.0, 9.0, *arrays, q)
    assert not inside
    np.testing.assert_allclose(q, [0.5, 0.5, 0.0], atol=1e-15)


def test_faces_without_area_are_left_out():
    mesh = TriangleMesh(np.eye(3), np.array([[0, 0, 1], [0, 1, 2]], dtype=np.int32))
    assert len(TriangleTree.of(mesh).triangles) == 1


def test_the_share_done_is_told_in_order(mesh, monkeypatch):
    monkeypatch.setattr(module, "_NODES_A_CALL", 3)
    shares = []
    TriangleTree.of(mesh, on_share=shares.append)
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert 0.5 < shares[-1] < 1.0
