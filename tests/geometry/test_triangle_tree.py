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


@pytest.fixture(scope="module")
def fine_ball():
    """A ball of 81,920 triangles."""
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.04)
    return TriangleTree.of(TriangleMesh(ball.vertices, np.asarray(ball.faces, np.int32)))


def triangles_of(tree, node):
    a, b = tree.child[node]
    if a < 0:
        return tree.triangles[-1 - a : -1 - a + b]
    return np.concatenate([triangles_of(tree, a), triangles_of(tree, b)])


def test_a_small_mesh_has_no_slabs(tree):
    assert tree.slabs.shape == (0, 5)


def test_slabs_hold_their_triangles_and_are_thin_where_the_surface_is_smooth(fine_ball, rng):
    tree = fine_ball
    assert tree.slabs.shape == (len(tree.child), 5)
    has_one = np.linalg.norm(tree.slabs[:, :3], axis=1) > 0.5
    assert not has_one[0]
    for node in rng.choice(np.flatnonzero(has_one), 60):
        normal, low, high = tree.slabs[node, :3], *tree.slabs[node, 3:]
        corners = triangles_of(tree, node).reshape(-1, 3)
        assert np.linalg.norm(normal) == pytest.approx(1.0)
        heights = corners @ normal
        assert (heights.min(), heights.max()) == pytest.approx((low, high), abs=1e-12)
        # Of a cap the height is at most (diameter / 2)^2 / radius.
        size = np.linalg.norm(np.ptp(corners, axis=0))
        assert high - low <= 1.05 * (0.5 * size) ** 2 / 0.04


def test_nodes_without_a_slab_are_those_with_many_triangles(fine_ball):
    tree = fine_ball
    none = np.flatnonzero(np.linalg.norm(tree.slabs[:, :3], axis=1) == 0.0)
    assert {len(triangles_of(tree, node)) > 4096 for node in none} == {True}
    assert len(none) == 31  # of 32 with 2560 each, and all above them
