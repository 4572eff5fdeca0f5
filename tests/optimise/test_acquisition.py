import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import norm

from gpis_grasp_planner.optimise.acquisition import (
    expected_improvement,
    log_expected_improvement,
)


def integrated(mean, std, best, xi):
    threshold = best + xi
    return quad(
        lambda y: (y - threshold) * norm.pdf(y, mean, std),
        max(threshold, mean - 12 * std),
        max(threshold, mean) + 12 * std,
        epsabs=1e-13,
        epsrel=1e-11,
        limit=200,
    )[0]


@pytest.mark.parametrize("mean", [-1.0, 0.0, 0.3, 2.0])
@pytest.mark.parametrize("std", [0.05, 0.5, 3.0])
@pytest.mark.parametrize("xi", [0.0, 0.01, 0.4])
def test_it_is_the_integral_of_the_improvement(mean, std, xi):
    expected = integrated(mean, std, 0.2, xi)
    got = expected_improvement([mean], [std], 0.2, xi)[0]
    assert got == pytest.approx(expected, rel=1e-7, abs=1e-12)
    if expected > 1e-10:
        assert log_expected_improvement([mean], [std], 0.2, xi)[0] == pytest.approx(
            np.log(expected), abs=1e-7
        )


def test_without_uncertainty_nothing_is_expected():
    # The paper's indicator: zero even where the mean is above the best.
    mean, std = np.array([5.0, -5.0, 5.0]), np.array([0.0, 0.0, -1.0])
    np.testing.assert_array_equal(expected_improvement(mean, std, 0.0), 0.0)
    np.testing.assert_array_equal(log_expected_improvement(mean, std, 0.0), -np.inf)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(
    mean=st.floats(-50, 50),
    std=st.floats(1e-3, 50),
    best=st.floats(-50, 50),
    xi=st.floats(0, 1),
)
def test_bounds_and_agreement_with_the_logarithm(mean, std, best, xi):
    value = expected_improvement([mean], [std], best, xi)[0]
    assert value >= max(mean - best - xi, 0.0) * (1 - 1e-12)
    assert value <= max(mean - best - xi, 0.0) + std / np.sqrt(2 * np.pi) + 1e-12
    if value > 1e-250:
        z = (mean - best - xi) / std
        # The plain formula cancels like z^2; the logarithm does not.
        np.testing.assert_allclose(
            log_expected_improvement([mean], [std], best, xi)[0],
            np.log(value),
            atol=1e-12 + 1e-15 * max(1.0, z * z) ** 2,
        )


def test_the_logarithm_has_a_slope_where_the_value_is_zero():
    z = -np.geomspace(1.0, 1e6, 400)
    log_values = log_expected_improvement(z, np.ones_like(z), 0.0)
    assert np.all(np.isfinite(log_values))
    assert np.all(np.diff(log_values) < 0)
    assert expected_improvement(z[-1:], [1.0], 0.0)[0] == 0.0
    # phi(z) / z^2 (1 - 3/z^2 + 15/z^4 ...), the asymptotic series
    far = z[z < -50]
    series = norm.logpdf(far) - 2 * np.log(-far) + np.log1p(-3 / far**2 + 15 / far**4)
    np.testing.assert_allclose(log_values[z < -50], series, rtol=1e-8)


def test_a_larger_xi_expects_less():
    xi = np.linspace(0, 2, 30)
    values = [expected_improvement([0.1], [0.7], 0.0, x)[0] for x in xi]
    assert np.all(np.diff(values) < 0)
