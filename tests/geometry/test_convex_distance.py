"""Polytope against mesh: brute force over all triangles, and another library's distance."""

import coal
import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.convex_distance import near_pairs, polytope_mesh
from gpis_grasp_planner.geometry.gjk import polytope_distance
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree


@pytest.fixture(scope="module")
def tree():
    torus = trimesh.creation.torus(
        major_radius=0.04, minor_radius=0.012, major_sections=32, minor_sections=16
    )
    return TriangleTree.of(
        TriangleMesh(np.asarray(torus.vertices), np.asarray(torus.faces, dtype=np.int32))
    )


@pytest.fixture(scope="module")
def link():
    """Vertices of a convex body in its own frame, off its origin."""
    points = np.random.default_rng(3).normal(size=(60, 3)) * [0.03, 0.008, 0.006] + [0.02, 0, 0]
    return points[ConvexHull(points).vertices]


def poses(rng, n):
    for _ in range(n):
        R = Rotation.random(rng=rng).as_matrix()
        yield R, rng.normal(size=3) * 0.045


def query(tree, link, R, t, limit=1.0, seed=-1):
    return polytope_mesh(
        np.ascontiguousarray(link @ R.T + t), R, t, link.min(axis=0), link.max(axis=0), limit,
        seed, tree.triangles, tree.lower, tree.upper, tree.child, tree.slabs,
    )  # fmt: skip


def all_pairs(tree, vertices):
    """Distances of all triangles, and the polytope's points (n, 3)."""
    out, own = np.empty(len(tree.triangles)), np.empty((len(tree.triangles), 3))
    q = np.empty(3)
    for f, triangle in enumerate(tree.triangles):
        out[f] = polytope_distance(vertices, triangle, 1e30, np.zeros(3), own[f], q)
    return out, own


def point_distances(tree, point):
    tiled = np.tile(point, (len(tree.triangles), 1))
    return np.linalg.norm(trimesh.triangles.closest_point(tree.triangles, tiled) - point, axis=1)


def all_distances(tree, vertices):
    return all_pairs(tree, vertices)[0]


def test_equals_brute_force_for_every_limit_and_seed(tree, link, rng):
    zeros = 0
    for R, t in poses(rng, 40):
        brute = all_distances(tree, np.ascontiguousarray(link @ R.T + t))
        expected = brute.min()
        zeros += expected == 0.0
        for seed in (-1, int(rng.integers(len(brute))), int(np.argmin(brute))):
            d = query(tree, link, R, t, seed=seed)
            assert d == pytest.approx(expected, abs=1e-11)
            assert (d == 0.0) == (expected == 0.0)
            assert query(tree, link, R, t, 0.004, seed) == pytest.approx(
                min(expected, 0.004), abs=1e-11
            )
    assert 5 < zeros < 35


def test_agrees_with_the_reference(tree, link, rng):
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(tree.triangles), 3 * len(tree.triangles))
    for triangle in tree.triangles:
        model.addTriangle(*triangle)
    model.endModel()
    vertices = coal.StdVec_Vec3s()
    for v in link:
        vertices.append(np.array(v))
    shape = coal.Convex.convexHull(vertices, False, "Qt")
    for R, t in poses(rng, 200):
        expected = coal.distance(
            shape, coal.Transform3s(R, t), model, coal.Transform3s(),
            coal.DistanceRequest(), coal.DistanceResult(),
        )  # fmt: skip
        d = query(tree, link, R, t)
        assert d == pytest.approx(max(expected, 0.0), abs=2e-6)


def test_moving_both_changes_nothing(tree, link, rng):
    Q, shift = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3)
    moved = TriangleTree.of(
        TriangleMesh(
            tree.triangles.reshape(-1, 3) @ Q.T + shift,
            np.arange(3 * len(tree.triangles), dtype=np.int32).reshape(-1, 3),
        )
    )
    for R, t in poses(rng, 60):
        assert query(moved, link, Q @ R, Q @ t + shift) == pytest.approx(
            query(tree, link, R, t), abs=1e-10
        )


def test_near_pairs_are_complete_and_right(tree, link, rng):
    p_self, p_other = np.empty((600, 3)), np.empty((600, 3))
    seen = 0
    for R, t in poses(rng, 40):
        vertices = np.ascontiguousarray(link @ R.T + t)
        brute, own = all_pairs(tree, vertices)
        if brute.min() == 0.0:
            continue
        limit = brute.min() + 0.002
        near = np.flatnonzero(brute < limit)
        nearest = np.array([point_distances(tree, point).min() for point in own[near]])
        brute = brute[near[nearest >= 0.999 * brute[near] - 1e-9]]
        count = near_pairs(
            vertices, R, t, link.min(axis=0), link.max(axis=0), limit,
            tree.triangles, tree.lower, tree.upper, tree.child, tree.slabs, p_self, p_other,
        )  # fmt: skip
        gaps = np.linalg.norm(p_self[:count] - p_other[:count], axis=1)
        np.testing.assert_allclose(np.sort(gaps), np.sort(brute), atol=1e-10)
        seen += count
    assert seen > 40


def test_near_pairs_fill_what_they_are_given_and_no_more(tree, link):
    p_self, p_other = np.full((4, 3), 9.0), np.full((4, 3), 9.0)
    R, t = np.eye(3), np.array([0.0, 0.0, 0.05])
    count = near_pairs(
        link + t, R, t, link.min(axis=0), link.max(axis=0), 1.0,
        tree.triangles, tree.lower, tree.upper, tree.child, tree.slabs, p_self[:3], p_other[:3],
    )  # fmt: skip
    assert 1 <= count <= 3
    np.testing.assert_array_equal(p_self[3], 9.0)
    np.testing.assert_array_less(p_self[:count], 9.0)


@pytest.fixture(scope="module")
def fine_tree(tree):
    """The same surface in 262,144 triangles."""
    mesh = trimesh.Trimesh(
        tree.triangles.reshape(-1, 3), np.arange(3 * len(tree.triangles)).reshape(-1, 3)
    )
    for _ in range(4):
        mesh = mesh.subdivide()
    return TriangleTree.of(TriangleMesh(mesh.vertices, np.asarray(mesh.faces, np.int32)))


def test_finer_triangles_of_the_same_surface_change_no_distance(tree, fine_tree, link, rng):
    away = 0
    for R, t in poses(rng, 60):
        expected = query(tree, link, R, t)
        away += expected > 0.0
        for seed in (-1, *map(int, rng.integers(len(fine_tree.triangles), size=3))):
            d = query(fine_tree, link, R, t, seed=seed)
            assert d == pytest.approx(expected, abs=1e-9), (R, t, seed)
            assert (d == 0.0) == (expected == 0.0)
            assert query(fine_tree, link, R, t, 0.004, seed) == pytest.approx(
                min(expected, 0.004), abs=1e-9
            )
    assert 10 < away < 55


def test_pairs_of_a_fine_mesh_are_of_the_whole_contact():
    """A plate flat on a face of 20,000 small triangles, and 64 rows for their pairs."""
    side = trimesh.creation.box((0.06, 0.04, 0.01))
    for _ in range(6):
        side = side.subdivide()
    fine = TriangleTree.of(TriangleMesh(side.vertices, np.asarray(side.faces, np.int32)))
    plate = np.array(
        [[x, y, z] for x in (-0.02, 0.02) for y in (-0.01, 0.01) for z in (0.0, 0.004)]
    )
    R, t = np.eye(3), np.array([0.004, -0.003, 0.0053])
    p_self, p_other = np.empty((64, 3)), np.empty((64, 3))
    count = near_pairs(
        plate + t, R, t, plate.min(axis=0), plate.max(axis=0), 0.001,
        fine.triangles, fine.lower, fine.upper, fine.child, fine.slabs, p_self, p_other,
    )  # fmt: skip
    assert 16 < count <= 64
    gaps = np.linalg.norm(p_self[:count] - p_other[:count], axis=1)
    assert gaps.max() < 0.001
    assert gaps.min() == pytest.approx(0.0003, abs=1e-9)
    # Every point of the plate's lower side has a pair near it.
    x, y = np.meshgrid(np.linspace(-0.02, 0.02, 41), np.linspace(-0.01, 0.01, 21))
    under = np.stack([x.ravel() + t[0], y.ravel() + t[1]], axis=1)
    apart = np.linalg.norm(under[:, None] - p_other[None, :count, :2], axis=2).min(axis=1)
    assert apart.max() < 0.008
