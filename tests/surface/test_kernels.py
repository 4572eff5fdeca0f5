"""Covariances of values and gradients: against finite differences, and positive definite."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gpis_grasp_planner.surface import kernels

KINDS = sorted(kernels.KERNELS)


def closed_form(kernel, r, length):
    """The textbook Matern functions, written a second time."""
    if kernel == "matern32":
        return (1 + math.sqrt(3) * r / length) * np.exp(-math.sqrt(3) * r / length)
    s = math.sqrt(5) * r / length
    return (1 + s + s * s / 3) * np.exp(-s)


@pytest.mark.parametrize("kernel", KINDS)
def test_value_is_the_textbook_matern(kernel, rng):
    a = kernels.inverse_length(kernel, 0.7)
    for r in [0.0, *rng.uniform(0.0, 4.0, 20)]:
        k, _, _ = kernels.radial(kernels.KERNELS[kernel], a, r)
        assert k == pytest.approx(closed_form(kernel, r, 0.7), rel=1e-13)


@pytest.mark.parametrize("kernel", KINDS)
def test_gradient_blocks_are_the_derivatives_of_the_value(kernel, rng):
    kind, a = kernels.KERNELS[kernel], kernels.inverse_length(kernel, 0.8)
    p, q = rng.normal(size=(2, 1, 3))

    def k(x, y):
        return kernels.covariance(kind, a, 1.3, 0.4, x, y)[0, 0]

    h = 1e-4
    step = h * np.eye(3)
    found = kernels.covariance(kind, a, 1.3, 0.4, p, q)
    over_q = [(k(p, q + s) - k(p, q - s)) / (2 * h) for s in step]
    over_p = [(k(p + s, q) - k(p - s, q)) / (2 * h) for s in step]
    both = [
        [
            (k(p + s, q + t) - k(p + s, q - t) - k(p - s, q + t) + k(p - s, q - t)) / (4 * h * h)
            for t in step
        ]
        for s in step
    ]
    np.testing.assert_allclose(found[0, 1:], over_q, atol=1e-7)
    np.testing.assert_allclose(found[1:, 0], over_p, atol=1e-7)
    np.testing.assert_allclose(found[1:, 1:], both, atol=2e-6)


@pytest.mark.parametrize("kernel", KINDS)
@pytest.mark.parametrize("length", [0.05, 0.5, 5.0, 50.0])
def test_symmetric_and_positive_definite(kernel, length, rng):
    p = rng.uniform(-1.0, 1.0, (40, 3))
    K = kernels.covariance(
        kernels.KERNELS[kernel], kernels.inverse_length(kernel, length), 1.0, 0.3, p, p
    )
    np.testing.assert_allclose(K, K.T, rtol=0, atol=1e-13 * np.abs(K).max())
    eigenvalues = np.linalg.eigvalsh(K)
    assert eigenvalues[0] > -1e-13 * eigenvalues[-1]


@pytest.mark.parametrize("kernel", sorted(kernels.KERNELS))
def test_the_upper_half_is_that_of_the_whole(kernel, rng):
    q = rng.normal(size=(9, 3))
    arguments = kernels.KERNELS[kernel], 0.7, 1.3, 0.4
    whole = kernels.covariance(*arguments, q, q)
    half = np.full((36, 36), np.nan)
    kernels.fill_upper_covariance(*arguments, q, half)
    upper = np.triu_indices(36)
    np.testing.assert_array_equal(half[upper], whole[upper])
