"""The covariance against numerical derivatives, and the posterior against what was observed."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.errors import MeshError
from gpis_grasp_planner.geometry.cloud.process import (
    Kernel,
    Observations,
    Posterior,
    cholesky,
    fill_covariance,
    value_covariance,
)

KERNEL = Kernel(length=0.3, slope=0.7)


def lower(K):
    return np.tril(K) + np.tril(K, -1).T


def test_the_covariance_of_gradients_is_that_of_differences(rng):
    x = rng.uniform(-0.5, 0.5, (5, 3))
    K = np.zeros((20, 20))
    fill_covariance(*KERNEL.scalars, x, K)
    h = 1e-4
    # Every observation as a difference of values: one point, or two at +-h along an axis.
    places = np.concatenate([x, *(x + s * h * e for e in np.eye(3) for s in (1, -1))])
    D = np.zeros((20, len(places)))
    for i in range(5):
        D[4 * i, i] = 1.0
        for t in range(3):
            D[4 * i + 1 + t, 5 + 10 * t + i] = 0.5 / h
            D[4 * i + 1 + t, 10 + 10 * t + i] = -0.5 / h
    expected = D @ value_covariance(*KERNEL.scalars, places, places) @ D.T
    np.testing.assert_allclose(lower(K), expected, atol=2e-3)
    assert np.linalg.eigvalsh(lower(K)).min() > 0.0


def test_the_posterior_goes_through_what_is_known_exactly(rng):
    x = rng.uniform(-0.5, 0.5, (8, 3))
    n = rng.normal(size=(8, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    seen = Observations(x, n, np.full(8, 1e-6), 1e-6)
    mean, slope = x @ [0.2, -0.1, 0.4], np.tile([0.2, -0.1, 0.4], (8, 1))
    posterior = Posterior.of(KERNEL, seen, mean, slope)

    def f(q):
        return q @ np.array([0.2, -0.1, 0.4]) + posterior.shift(q)

    np.testing.assert_allclose(f(x), 0.0, atol=1e-6)
    h = 1e-5
    found = np.stack([(f(x + s) - f(x - s)) / (2 * h) for s in h * np.eye(3)], axis=1)
    np.testing.assert_allclose(found, n, atol=2e-3)
    np.testing.assert_allclose(posterior.deviation(x), 0.0, atol=1e-5)
    far = np.array([[30.0, 0.0, 0.0]])
    np.testing.assert_allclose(f(far), far @ [0.2, -0.1, 0.4], atol=1e-9)
    # Far away the process has the variance of the prior: (slope length)^2 / 3.
    np.testing.assert_allclose(posterior.deviation(far), 0.7 * 0.3 / np.sqrt(3.0), rtol=1e-9)
    q = rng.uniform(-0.5, 0.5, (6, 3))
    np.testing.assert_allclose(np.sqrt(np.diag(posterior.covariance(q))), posterior.deviation(q))


def test_an_indefinite_covariance_is_refused():
    with pytest.raises(MeshError, match="not positive definite"):
        cholesky(np.array([[1.0, 2.0], [2.0, 1.0]]), np.zeros(2))
