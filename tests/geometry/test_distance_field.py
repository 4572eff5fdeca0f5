"""The distance field against analytic distances and another library's."""

import numpy as np
import pytest
import trimesh

from gpis_grasp_planner.geometry import distance_field as module
from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.mesh import TriangleMesh


def mesh_of(t):
    return TriangleMesh(np.asarray(t.vertices, dtype=float), np.asarray(t.faces, dtype=np.int32))


@pytest.fixture(scope="module")
def ring():
    """A torus: concave, with a hole through it."""
    return trimesh.creation.torus(
        major_radius=0.04, minor_radius=0.012, major_sections=24, minor_sections=12
    )


@pytest.fixture(scope="module")
def field(ring):
    return DistanceField.of(mesh_of(ring), cells=64)


def grid_points(field):
    index = np.stack(np.meshgrid(*[np.arange(n) for n in field.values.shape], indexing="ij"), -1)
    return (field.origin + field.spacing * index).reshape(-1, 3)


def exact(t, points):
    """Distance to the nearest of all triangles, one triangle after the other."""
    best = np.full(len(points), np.inf)
    for triangle in t.triangles:
        nearest = trimesh.triangles.closest_point(np.tile(triangle, (len(points), 1, 1)), points)
        np.minimum(best, np.linalg.norm(nearest - points, axis=1), out=best)
    return best


def winding(t, points):
    """How often the mesh winds around points: the sum of its triangles' solid angles."""
    total = np.zeros(len(points))
    for triangle in t.triangles:
        a, b, c = (corner - points for corner in triangle)
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        dots = [np.einsum("ij,ij->i", u, v) for u, v in ((a, b), (b, c), (c, a))]
        total += np.arctan2(volume, la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb)
    return total / (2.0 * np.pi)


def test_grid_points_near_the_surface_are_exact_and_far_ones_within_a_cell(ring, field, rng):
    points = grid_points(field)
    values = field.values.reshape(-1).astype(float)
    chosen = rng.choice(len(points), 1200, replace=False)
    distance = exact(ring, points[chosen])
    error = np.abs(values[chosen]) - distance
    near = distance < 1.9 * field.spacing
    assert near.sum() > 100
    assert np.abs(error[near]).max() < 1e-8
    assert error.min() > -1e-8  # the distance to some triangle is never too small
    assert error.max() < field.spacing


def test_sign_is_that_of_the_solid(ring, field, rng):
    points = rng.uniform(*ring.bounds, size=(900, 3))
    clear = exact(ring, points) > field.spacing
    inside = winding(ring, points[clear]) > 0.5
    assert inside.sum() > 100
    np.testing.assert_array_equal(field.value(points[clear]) < 0.0, inside)


def test_interpolated_values_of_a_sphere_follow_the_radius(rng):
    radius = 0.03
    sphere = mesh_of(trimesh.creation.icosphere(subdivisions=4, radius=radius))
    field = DistanceField.of(sphere, cells=64)
    points = rng.normal(size=(3000, 3))
    points *= (rng.uniform(0.6, 1.15, 3000) * radius / np.linalg.norm(points, axis=1))[:, None]
    expected = np.linalg.norm(points, axis=1) - radius
    error = np.abs(field.value(points) - expected)
    # facets lie up to 1e-4 below the sphere
    assert error[np.abs(expected) < 1.9 * field.spacing].max() < 1.5e-4
    assert error.max() < field.spacing
    near = points[np.abs(expected) < field.spacing]
    cosine = np.einsum("ij,ij->i", field.outward(near), near) / np.linalg.norm(near, axis=1)
    assert cosine.min() > np.cos(0.08)


def test_beyond_the_grid_the_value_is_a_lower_bound_that_grows(ring, field, rng):
    direction = rng.normal(size=(500, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    for reach in (0.08, 0.2, 1.0):
        points = direction * reach
        value, distance = field.value(points), exact(ring, points)
        assert (value <= distance + 1.75 * field.spacing).all()
        assert (value >= 0.2 * distance).all()


def test_value_is_continuous_across_the_border_of_the_grid(field):
    corner = field.origin + field.spacing * (np.array(field.values.shape) - 1.001)
    middle = 0.5 * (field.origin + corner)
    for axis in range(3):
        line = np.tile(middle, (200, 1))
        line[:, axis] = corner[axis] + np.linspace(-1.0, 1.0, 200) * field.spacing
        steps = np.abs(np.diff(field.value(line)))
        assert steps.max() < 0.05 * field.spacing


@pytest.mark.parametrize("normal", [(0, 0, 1), (1, 1, 1), (1, -2, 0.5), (-1, 0, 3)])
def test_an_open_sheet_has_no_inside(normal):
    normal = np.array(normal) / np.linalg.norm(normal)
    u = np.cross(normal, [0.3, 0.5, 0.1])
    u /= np.linalg.norm(u)
    v = np.cross(normal, u)
    corners = 0.04 * np.array([s * u + t * v for s in (-1, 1) for t in (-1, 1)])
    sheet = TriangleMesh(corners, np.array([[0, 1, 3], [0, 3, 2]], dtype=np.int32))
    assert DistanceField.of(sheet, cells=32).values.min() >= 0.0


def test_a_hole_does_not_turn_a_mesh_inside_out(rng):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.03)
    keep = ball.triangles_center[:, 2] < 0.0285
    assert 0 < (~keep).sum() < 40
    field = DistanceField.of(
        TriangleMesh(np.asarray(ball.vertices), np.asarray(ball.faces[keep], dtype=np.int32)),
        cells=48,
    )
    points = rng.uniform(-0.03, 0.03, size=(4000, 3))
    radius = np.linalg.norm(points, axis=1)
    sure = np.abs(radius - 0.03) > 2.5 * field.spacing
    sure &= ~((np.hypot(points[:, 0], points[:, 1]) < 0.011) & (points[:, 2] > 0.02))
    np.testing.assert_array_equal(field.value(points[sure]) < 0.0, radius[sure] < 0.03)


def test_faces_without_area_are_no_obstacle(write):
    vertices, faces = write.box_arrays((0.04, 0.04, 0.04))
    good = DistanceField.of(TriangleMesh(vertices, faces.astype(np.int32)), cells=24)
    faces = np.vstack([faces, [[0, 0, 1], [2, 2, 2]]]).astype(np.int32)
    np.testing.assert_array_equal(
        DistanceField.of(TriangleMesh(vertices, faces), cells=24).values, good.values
    )


def test_translating_the_mesh_translates_the_field(ring, field):
    shift = np.array([0.25, -0.5, 0.125])
    moved = DistanceField.of(
        TriangleMesh(np.asarray(ring.vertices) + shift, np.asarray(ring.faces, dtype=np.int32)),
        cells=64,
    )
    np.testing.assert_allclose(moved.origin - shift, field.origin, atol=1e-12)
    # far values may come from another one of equally near triangles
    difference = np.abs(moved.values - field.values)
    assert difference[np.abs(field.values) < 1.9 * field.spacing].max() < 2e-7
    assert difference.max() < field.spacing
    np.testing.assert_array_equal(moved.values < 0.0, field.values < 0.0)


def test_a_mesh_in_pieces_gives_the_same_field(ring, field, monkeypatch):
    monkeypatch.setattr(module, "_TRIANGLES_A_CALL", 7)
    shares = []
    again = DistanceField.of(mesh_of(ring), cells=64, on_share=shares.append)
    np.testing.assert_array_equal(again.values, field.values)
    assert shares == sorted(shares)
    assert len(shares) > len(ring.faces) // 7
