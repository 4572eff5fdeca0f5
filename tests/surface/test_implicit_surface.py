"""Known shapes: sign and scale of the value, gradient, variance, equivariance, bad input."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.surface.implicit_surface import (
    ImplicitSurface,
    fit_part,
    merge_duplicates,
)
from gpis_grasp_planner.surface.settings import SurfaceSettings

RADIUS = 0.04
SMALL = SurfaceSettings(n_samples=2000)


@pytest.fixture(scope="module")
def sphere(shapes):
    return ImplicitSurface.fit(*shapes.sphere_samples(1500, RADIUS))


def directions(rng, n):
    u = rng.normal(size=(n, 3))
    return u / np.linalg.norm(u, axis=1, keepdims=True)


def test_sphere_value_is_the_signed_distance(sphere, rng):
    u = directions(rng, 500)
    for height, tolerance in ((0.0, 5e-6), (0.0005, 2e-5), (-0.0005, 2e-5), (0.003, 3e-4)):
        found = sphere.value((RADIUS + height) * u)
        np.testing.assert_allclose(found, height, atol=tolerance)


def test_sphere_value_far_from_the_samples(sphere, rng):
    u = directions(rng, 200)
    for r in (0.001, 0.01, 0.02, 0.06, 0.2, 3.0):
        np.testing.assert_allclose(sphere.value(r * u), r - RADIUS, rtol=0.12, atol=2e-4)


def test_sphere_gradient_is_the_normal(sphere, rng):
    u = directions(rng, 500)
    gradient = sphere.gradient(RADIUS * u)
    length = np.linalg.norm(gradient, axis=1)
    np.testing.assert_allclose(length, 1.0, atol=0.03)
    angle = np.degrees(np.arccos(np.einsum("ij,ij->i", gradient, u) / length))
    assert angle.max() < 1.0


def test_cylinder_and_its_caps(shapes, rng):
    radius, height = 0.03, 0.1
    surface = fit_part(shapes.cylinder_mesh(radius, height), SMALL, seed=3)
    angle = rng.uniform(0.0, 2 * np.pi, 300)
    wall = np.column_stack(
        [radius * np.cos(angle), radius * np.sin(angle), rng.uniform(-0.04, 0.04, 300)]
    )
    outward = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(300)])
    cap = np.column_stack([rng.uniform(-0.015, 0.015, (300, 2)), np.full(300, height / 2)])
    up = np.tile([0.0, 0.0, 1.0], (300, 1))
    for points, normals in ((wall, outward), (cap, up)):
        for h in (-1e-3, 0.0, 1e-3):
            np.testing.assert_allclose(surface.value(points + h * normals), h, atol=1.2e-4)
        gradient = surface.gradient(points)
        cosine = np.einsum("ij,ij->i", gradient, normals) / np.linalg.norm(gradient, axis=1)
        assert np.degrees(np.arccos(np.median(cosine))) < 3.0
        assert np.degrees(np.arccos(cosine.min())) < 8.0


def test_box_sign_everywhere_and_scale_off_the_edges(shapes, rng):
    size = np.array([0.1, 0.07, 0.05])
    surface = fit_part(shapes.box_mesh(size), SMALL, seed=3)
    x = rng.uniform(-1.0, 1.0, (4000, 3)) * size
    exact = shapes.box_distance(x, size)
    found = surface.value(x)
    clear = np.abs(exact) > 5e-4
    np.testing.assert_array_equal(np.sign(found[clear]), np.sign(exact[clear]))
    assert np.median(np.abs(found - exact) / np.abs(exact)) < 0.05
    corner_free = rng.uniform(-0.35, 0.35, (500, 3)) * size
    corner_free[:, 2] = size[2] / 2
    np.testing.assert_allclose(surface.value(corner_free), 0.0, atol=2e-5)
    np.testing.assert_allclose(
        surface.gradient(corner_free), np.tile([0, 0, 1.0], (500, 1)), atol=0.02
    )


@pytest.mark.parametrize("wall_mm", [2.0, 3.0])
def test_thin_walls_keep_both_sides_apart(shapes, rng, wall_mm):
    size, wall = np.array([0.1, 0.08, 0.06]), 1e-3 * wall_mm
    surface = fit_part(shapes.hollow_box_mesh(size, wall), SurfaceSettings(), seed=3)
    inner = size - 2 * wall
    x = rng.uniform(-0.35, 0.35, (500, 3)) * size
    for depth in (0.0, wall):
        x[:, 0] = size[0] / 2 - depth
        np.testing.assert_allclose(surface.value(x), 0.0, atol=1e-4)
    # In front of a wall of about one sample spacing the value grows faster than the distance.
    for height, most in ((2e-4, 1.15), (1e-3, 1.4)):
        for depth in (-height, wall + height):
            x[:, 0] = size[0] / 2 - depth
            value = surface.value(x)
            assert (value > 0.8 * height - 2e-5).all()
            assert (value < most * height + 2e-5).all()
    x[:, 0] = size[0] / 2 - wall / 2
    assert (surface.value(x) < -wall / 8).all()
    x = rng.uniform(-0.6, 0.6, (4000, 3)) * size
    exact = np.maximum(shapes.box_distance(x, size), -shapes.box_distance(x, inner))
    clear = np.abs(exact) > 5e-4
    np.testing.assert_array_equal(np.sign(surface.value(x)[clear]), np.sign(exact[clear]))


@pytest.mark.parametrize("kernel", ["matern32", "matern52"])
def test_gradient_against_finite_differences(shapes, rng, kernel):
    settings = SurfaceSettings(n_samples=1500, kernel=kernel)
    surface = fit_part(shapes.hollow_box_mesh((0.1, 0.08, 0.06), 0.004), settings, seed=3)
    index = rng.integers(len(surface.points), size=400)
    # Near the surface, through the band where the far field takes over, and beyond it.
    x = surface.points[index] + rng.exponential(0.008, (400, 1)) * directions(rng, 400)
    h = 1e-7
    numeric = np.stack(
        [(surface.value(x + s) - surface.value(x - s)) / (2 * h) for s in h * np.eye(3)], axis=1
    )
    error = np.abs(numeric - surface.gradient(x)).max(axis=1)
    # On the bisector of two nearest samples the far field has a kink, seen by chance.
    assert np.mean(error > 1e-4) <= 0.005
    near = surface._nearest_sample(x)[0] < 0.002
    assert near.sum() > 50
    assert error[near].max() < 1e-4


def test_variance_is_small_at_samples_and_grows_away(sphere, rng):
    u = directions(rng, 50)
    at_samples = sphere.variance(sphere.points[::30])
    assert np.sqrt(at_samples.max()) < 5e-6
    deviations = [
        np.sqrt(sphere.variance((RADIUS + h) * u)).mean() for h in (0, 0.001, 0.003, 0.01, 0.03)
    ]
    assert (np.diff(deviations) > 0).all()
    assert deviations[-1] == pytest.approx(0.03, rel=0.05)
    between = sphere.variance(RADIUS * u)
    assert (between >= 0).all()
    assert np.sqrt(between.max()) < 2e-4


def test_a_hole_in_the_samples_has_more_variance(shapes):
    points, normals = shapes.sphere_samples(1500, RADIUS)
    keep = points[:, 2] < 0.8 * RADIUS
    surface = ImplicitSurface.fit(points[keep], normals[keep])
    pole, equator = RADIUS * np.eye(3)[[2, 0]]
    assert surface.variance(pole[None])[0] > 100 * surface.variance(equator[None])[0]


def test_rigid_motion_moves_the_surface_with_it(shapes, rng, seed):
    points, normals = shapes.sphere_samples(600, RADIUS)
    points, normals = points * [1.0, 0.7, 0.5], normals / [1.0, 0.7, 0.5]
    R, t = Rotation.random(rng=seed).as_matrix(), np.array([1.0, -2.0, 0.5])
    x = points[::7] + rng.normal(scale=0.004, size=points[::7].shape)
    here = ImplicitSurface.fit(points, normals)
    there = ImplicitSurface.fit(points @ R.T + t, normals @ R.T)
    np.testing.assert_allclose(there.value(x @ R.T + t), here.value(x), atol=1e-9)
    np.testing.assert_allclose(there.gradient(x @ R.T + t), here.gradient(x) @ R.T, atol=1e-5)
    np.testing.assert_allclose(there.variance(x @ R.T + t), here.variance(x), rtol=1e-2, atol=1e-13)


@given(scale=st.floats(0.01, 100.0))
def test_scale_of_the_object_scales_the_value(scale):
    i = np.arange(200) + 0.5
    z, angle = 1 - i / 100, np.pi * (1 + 5**0.5) * i
    r = np.sqrt(1 - z * z)
    normals = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    x = 1.03 * normals[::9] * RADIUS
    one = ImplicitSurface.fit(RADIUS * normals, normals).value(x)
    other = ImplicitSurface.fit(scale * RADIUS * normals, normals).value(scale * x)
    np.testing.assert_allclose(other, scale * one, rtol=1e-6)


def test_batches_change_nothing(sphere, rng):
    x = RADIUS * rng.normal(size=(64, 3))
    whole, gradient = sphere.value_and_gradient(x)
    for i in range(0, 64, 7):
        np.testing.assert_array_equal(sphere.value(x[i : i + 1]), whole[i : i + 1])
        np.testing.assert_array_equal(sphere.gradient(x[i : i + 1]), gradient[i : i + 1])
    assert sphere.value(np.zeros((0, 3))).shape == (0,)
    assert sphere.gradient(np.zeros((0, 3))).shape == (0, 3)
    assert sphere.variance(np.zeros((0, 3))).shape == (0,)


def test_equal_seeds_give_equal_surfaces(shapes, rng):
    mesh = shapes.box_mesh((0.1, 0.07, 0.05))
    x = 0.04 * rng.normal(size=(50, 3))
    one, two = (fit_part(mesh, SMALL, seed=8).value(x) for _ in range(2))
    np.testing.assert_array_equal(one, two)


def test_duplicates_are_merged(shapes, rng):
    points, normals = shapes.sphere_samples(300, RADIUS)
    twice = ImplicitSurface.fit(np.tile(points, (3, 1)), np.tile(normals, (3, 1)))
    assert len(twice.points) == 300
    assert cKDTree(points).query(twice.points)[0].max() < 1e-12
    x = RADIUS * directions(rng, 100)
    np.testing.assert_allclose(twice.value(x), 0.0, atol=2e-4)


def test_nearly_coincident_samples_stay_finite(shapes, rng):
    points, normals = shapes.sphere_samples(300, RADIUS)
    noisy = np.concatenate([points, points + 3e-7 * directions(rng, 300)])
    surface = ImplicitSurface.fit(noisy, np.tile(normals, (2, 1)))
    value, gradient = surface.value_and_gradient(RADIUS * directions(rng, 100))
    np.testing.assert_allclose(value, 0.0, atol=2e-4)
    assert np.isfinite(gradient).all()


def test_merging_averages_normals_and_drops_sheets():
    points = np.array([[0.0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0], [2, 0, 0]])
    normals = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1], [0, 1, 0]])
    merged, mean = merge_duplicates(points, normals, 1e-7)
    np.testing.assert_allclose(merged, [[0, 0, 0], [2, 0, 0]])
    np.testing.assert_allclose(mean, [[np.sqrt(0.5), np.sqrt(0.5), 0], [0, 1, 0]])


def test_coplanar_samples_give_the_plane(rng):
    points = np.column_stack([rng.uniform(-0.05, 0.05, (300, 2)), np.zeros(300)])
    surface = ImplicitSurface.fit(points, np.tile([0.0, 0.0, 2.5], (300, 1)))
    x = np.column_stack([rng.uniform(-0.03, 0.03, (50, 2)), rng.uniform(-0.004, 0.004, 50)])
    np.testing.assert_allclose(surface.value(x), x[:, 2], rtol=0.05, atol=1e-6)


def test_four_samples_are_enough_and_three_too_few(shapes):
    points, normals = shapes.sphere_samples(4, RADIUS)
    assert np.isfinite(ImplicitSurface.fit(points, normals).value(points)).all()
    with pytest.raises(MeshError, match="3 distinct surface samples") as caught:
        ImplicitSurface.fit(points[:3], normals[:3])
    assert caught.value.code == ErrorCode.MESH_DEGENERATE
    with pytest.raises(MeshError, match="1 distinct"):
        ImplicitSurface.fit(np.zeros((50, 3)), np.tile([0.0, 0, 1], (50, 1)))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_non_finite_input_is_refused(sphere, shapes, bad):
    points, normals = shapes.sphere_samples(50, RADIUS)
    for place in (0, 1):
        samples = [points.copy(), normals.copy()]
        samples[place][17, 1] = bad
        with pytest.raises(MeshError, match="Point 17 is not finite") as caught:
            ImplicitSurface.fit(*samples)
        assert caught.value.code == ErrorCode.MESH_NOT_FINITE
    for method in (sphere.value, sphere.gradient, sphere.variance):
        with pytest.raises(MeshError, match="Point 1 is not finite"):
            method([[0.0, 0, 0], [0, bad, 0]])


def test_wrong_shapes_and_zero_normals_are_refused(sphere, shapes):
    points, normals = shapes.sphere_samples(50, RADIUS)
    with pytest.raises(MeshError, match="50 surface samples come with 49 normals"):
        ImplicitSurface.fit(points, normals[1:])
    with pytest.raises(MeshError, match=r"shape \(3,\)"):
        sphere.value([0.0, 0.0, 0.0])
    normals[7] = 0.0
    with pytest.raises(MeshError, match="sample 7 is zero"):
        ImplicitSurface.fit(points, normals)
