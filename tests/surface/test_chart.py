"""Tangent bases of eq. (4), their points, and the way back to the zero set."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.surface.chart import Chart, project, tangent_basis
from gpis_grasp_planner.surface.implicit_surface import ImplicitSurface

RADIUS = 0.04


@pytest.fixture(scope="module")
def sphere(shapes):
    return ImplicitSurface.fit(*shapes.sphere_samples(1000, RADIUS))


@given(st.tuples(*3 * [st.floats(-1.0, 1.0)]).filter(lambda n: np.linalg.norm(n) > 1e-3))
def test_basis_solves_equation_4_and_is_right_handed(direction):
    n = np.array(direction) / np.linalg.norm(direction)
    basis = tangent_basis(n)
    np.testing.assert_allclose(n @ basis, 0.0, atol=1e-14)
    np.testing.assert_allclose(basis.T @ basis, np.eye(2), atol=1e-14)
    np.testing.assert_allclose(np.cross(basis[:, 0], basis[:, 1]), n, atol=1e-14)


def test_chart_of_a_sphere_has_the_outward_normal(sphere, rng):
    for point in sphere.points[rng.integers(1000, size=20)]:
        chart = Chart.at(sphere, point)
        np.testing.assert_array_equal(chart.center, point)
        np.testing.assert_allclose(chart.normal_outward, point / RADIUS, atol=2e-3)
        assert np.linalg.norm(chart.normal_outward) == pytest.approx(1.0, abs=1e-14)


def test_chart_points_span_the_tangent_plane(sphere, rng):
    chart = Chart.at(sphere, sphere.points[10])
    u = rng.normal(scale=0.01, size=(30, 2))
    x = chart.points(u)
    np.testing.assert_allclose((x - chart.center) @ chart.normal_outward, 0.0, atol=1e-16)
    np.testing.assert_allclose((x - chart.center) @ chart.basis, u, atol=1e-16)
    np.testing.assert_array_equal(chart.points(np.zeros((1, 2)))[0], chart.center)


def test_chart_points_come_back_to_the_surface(sphere, rng):
    chart = Chart.at(sphere, sphere.points[10])
    x = chart.surface_points(sphere, rng.uniform(-0.005, 0.005, (30, 2)))
    np.testing.assert_allclose(np.linalg.norm(x, axis=1), RADIUS, atol=1e-5)


def test_projection_ends_on_the_zero_set(sphere, rng):
    start = sphere.points + rng.normal(scale=0.002, size=sphere.points.shape)
    before = start.copy()
    x, converged = project(sphere, start)
    assert converged.all()
    np.testing.assert_array_equal(start, before)
    np.testing.assert_allclose(sphere.value(x), 0.0, atol=1e-7)
    moved = np.linalg.norm(x - start, axis=1)
    np.testing.assert_allclose(moved, np.abs(np.linalg.norm(start, axis=1) - RADIUS), atol=2e-4)


def test_projection_says_where_it_failed(sphere):
    x, converged = project(sphere, [[0.0, 0.0, 0.001], [0.0, 0.0, 0.0405]], max_iterations=0)
    assert not converged.any()
    np.testing.assert_array_equal(x, [[0.0, 0.0, 0.001], [0.0, 0.0, 0.0405]])


class Flat:
    """A surface whose gradient vanishes."""

    def value_and_gradient(self, points):
        return np.ones(len(points)), np.zeros((len(points), 3))

    def gradient(self, points):
        return np.zeros((len(points), 3))


def test_a_vanishing_gradient_is_an_error_and_no_nan():
    with pytest.raises(MeshError, match="gradient of the implicit surface") as caught:
        Chart.at(Flat(), [0.0, 0.0, 0.0])
    assert caught.value.code == ErrorCode.MESH_DEGENERATE
    x, converged = project(Flat(), np.eye(3))
    assert not converged.any()
    np.testing.assert_array_equal(x, np.eye(3))
