import numpy as np
import pytest
from scipy.special import gamma, kv

from gpis_grasp_planner.optimise.distances import (
    EuclideanDistance,
    GeodesicSumDistance,
    PoseDistance,
    pose_features,
)
from gpis_grasp_planner.optimise.kernel import correlation, correlation_with_slopes, matern52


def test_it_is_the_general_matern_function_at_five_halves():
    d = np.geomspace(1e-3, 20, 200)
    nu = 2.5
    x = np.sqrt(2 * nu) * d
    expected = 2 ** (1 - nu) / gamma(nu) * x**nu * kv(nu, x)
    np.testing.assert_allclose(matern52(d.copy()), expected, rtol=1e-11)
    np.testing.assert_array_equal(matern52(np.zeros(1)), 1.0)


@pytest.mark.parametrize(
    "distance",
    [EuclideanDistance(range(12)), PoseDistance(), GeodesicSumDistance()],
    ids=lambda d: type(d).__name__,
)
def test_slopes_are_the_derivatives_by_the_log_scales(distance, random_poses):
    F = pose_features(*random_poses(15, 1))
    log_scales = np.log(np.linspace(0.3, 0.9, distance.n_scales))
    k, slopes = correlation_with_slopes(distance, distance.parts(F), np.exp(log_scales))
    np.testing.assert_allclose(k, correlation(distance, F, F, np.exp(log_scales)), atol=1e-6)
    h = 1e-5
    for g in range(distance.n_scales):
        step = h * np.eye(distance.n_scales)[g]
        difference = correlation(distance, F, F, np.exp(log_scales + step)) - correlation(
            distance, F, F, np.exp(log_scales - step)
        )
        off = ~np.eye(15, dtype=bool)
        np.testing.assert_allclose(slopes[g][off], (difference / (2 * h))[off], atol=1e-8)
        np.testing.assert_allclose(np.diag(slopes[g]), 0.0, atol=1e-12)
