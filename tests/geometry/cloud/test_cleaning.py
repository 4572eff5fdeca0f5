"""The noise is recovered, outliers are found, and clouds without a surface are refused."""

from __future__ import annotations

import numpy as np
import pytest
from cloud_shapes import CENTER, RADIUS, box_points, sphere_points
from hypothesis import given
from hypothesis import strategies as st

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.cloud.cleaning import inliers, noise_and_neighbours, thinned


@given(st.integers(0, 2**16), st.sampled_from([0.0003, 0.0005, 0.001, 0.002]))
def test_the_noise_of_a_ball_is_estimated_within_a_tenth(seed, noise):
    points, _ = sphere_points(np.random.default_rng(seed), 3000, noise)
    assert noise_and_neighbours(points, "ball")[0] == pytest.approx(noise, rel=0.1)


def test_the_noise_of_a_box_is_not_taken_for_its_edges(rng):
    for noise in (0.0003, 0.001):
        points, _ = box_points(rng, noise=noise)
        assert noise_and_neighbours(points, "box")[0] == pytest.approx(noise, rel=0.2)
    exact, _ = box_points(rng)
    assert noise_and_neighbours(exact, "box")[0] < 1e-4


def test_outliers_are_taken_out_and_nearly_nothing_else(rng):
    points, _ = sphere_points(rng, 3000, 0.0005)
    stray = rng.uniform(-0.3, 0.3, (60, 3)) + CENTER
    kept = inliers(np.concatenate([points, stray]), "cloud")
    near = np.abs(np.linalg.norm(stray - CENTER, axis=1) - RADIUS) < 0.01
    assert (kept >= 3000).sum() <= near.sum() + 2
    assert (kept < 3000).sum() > 2900


def test_points_that_are_no_surface_are_refused(rng):
    with pytest.raises(MeshError, match=r"scatter by .* mm") as caught:
        noise_and_neighbours(rng.normal(size=(2000, 3)), "fog.xyz")
    assert caught.value.code == ErrorCode.MESH_DEGENERATE


def test_too_few_points_are_refused_with_the_limit(rng):
    with pytest.raises(MeshError, match="has 60 distinct points; a surface takes at least 100"):
        inliers(sphere_points(rng, 60)[0], "cloud")


def test_equal_points_count_once_and_many_are_thinned(rng):
    points = rng.normal(size=(40_000, 3))
    assert len(thinned(points)) == 30_000
    assert len(thinned(np.repeat(points[:200], 5, axis=0))) == 200
    np.testing.assert_array_equal(thinned(points), thinned(points))
