"""What a viewpoint knows to be empty is outside the body, and never inside it."""

from __future__ import annotations

import numpy as np
from cloud_shapes import CENTER, RADIUS, sphere_points

from gpis_grasp_planner.geometry.cloud.views import View, spacing_of, spread

EYE = CENTER + np.array([0.0, 0.0, 0.5])


def test_nothing_inside_is_called_empty_and_most_of_what_is_beside_is(rng):
    points, _ = sphere_points(rng, 4000, 0.0005, cap=RADIUS / 0.5)  # what the eye can see
    view = View.of(points, EYE, spacing_of(points), 0.0005)
    x = CENTER + rng.uniform(-2.0, 2.0, (5000, 3)) * RADIUS
    r = np.linalg.norm(x - CENTER, axis=1)
    empty = view.emptiness(x)
    assert (empty[r < RADIUS] <= 0.0).all()
    way = (x - EYE) / np.linalg.norm(x - EYE, axis=1, keepdims=True)
    passes = np.linalg.norm(np.cross(way, CENTER - EYE), axis=1)  # of the ray, at the centre
    assert (empty[passes > 1.2 * RADIUS] > 0.0).all()
    before = (passes < 0.8 * RADIUS) & (x[:, 2] > CENTER[2] + 1.3 * RADIUS)
    assert before.any()
    assert (empty[before] > 0.0).all()


def test_the_back_of_a_ball_is_not_seen(rng):
    points, normals = sphere_points(rng, 6000)
    view = View.of(points, EYE, spacing_of(points), 0.0)
    seen = view.sees()
    assert seen[normals[:, 2] > 0.3].mean() > 0.99
    # Where the points leave a hole before it, it is called seen.
    assert seen[normals[:, 2] < -0.5].mean() < 0.03


def test_of_many_viewpoints_six_that_are_far_apart(rng):
    ways = rng.normal(size=(40, 3))
    chosen = spread(ways, 6)
    assert len(chosen) == 6
    assert len(np.unique(chosen, axis=0)) == 6
    assert len(spread(ways[:2], 6)) == 2
    assert spread(ways[:0], 6).shape == (0, 3)
    assert spread(ways, 0).shape == (0, 3)
