"""The ellipsoid that is believed: of a half seen ball the whole ball."""

from __future__ import annotations

import numpy as np
import pytest
from cloud_shapes import CENTER, RADIUS, box_points, sphere_points

from gpis_grasp_planner.geometry.cloud.prior import Ellipsoid


@pytest.mark.parametrize("cap", [-1.0, 0.0])
def test_of_a_ball_the_ball(rng, cap):
    points, normals = sphere_points(rng, 4000, cap=cap)
    found = Ellipsoid.of(points, normals)
    np.testing.assert_allclose(found.center, CENTER, atol=0.05 * RADIUS)
    np.testing.assert_allclose(found.half, RADIUS, rtol=0.08)


def test_a_box_seen_on_all_sides_has_its_middle(rng):
    points, normals = box_points(rng)
    found = Ellipsoid.of(points, normals)
    np.testing.assert_allclose(found.center, 0.0, atol=0.002)


def test_values_are_signed_distances_of_a_ball_and_gradients_their_slopes(rng):
    ball = Ellipsoid(CENTER, np.eye(3), np.full(3, RADIUS))
    x = CENTER + rng.normal(scale=RADIUS, size=(50, 3))
    r = np.linalg.norm(x - CENTER, axis=1)
    np.testing.assert_allclose(ball.value(x), r - RADIUS, atol=1e-9)
    np.testing.assert_allclose(ball.gradient(x), (x - CENTER) / r[:, None], atol=1e-4)
