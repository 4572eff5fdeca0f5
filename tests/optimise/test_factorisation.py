import numpy as np
import pytest
from scipy.optimize import approx_fprime

from gpis_grasp_planner.errors import SystemFault
from gpis_grasp_planner.optimise.factorisation import CholeskyFactor, SpectralFactor


def covariance(n, seed, definite=True):
    rng = np.random.default_rng(seed)
    U = np.linalg.qr(rng.normal(size=(n, n)))[0]
    values = rng.uniform(0.5, 3.0, n)
    if not definite:
        values[: n // 4] *= -0.3
    return (U * values) @ U.T


@pytest.mark.parametrize("kind", [CholeskyFactor, SpectralFactor])
def test_definite_matrices_are_whitened_and_solved(kind):
    K, noise = covariance(30, 1), 0.1
    C = K + noise * np.eye(30)
    factor = kind(K, noise)
    rng = np.random.default_rng(2)
    B = rng.normal(size=(30, 4))
    np.testing.assert_allclose(factor.solve(B[:, 0]), np.linalg.solve(C, B[:, 0]), atol=1e-12)
    white = factor.whiten(B)
    np.testing.assert_allclose(white.T @ white, B.T @ np.linalg.solve(C, B), atol=1e-12)
    assert factor.log_determinant == pytest.approx(np.linalg.slogdet(C)[1], abs=1e-12)
    assert factor.inverse_trace == pytest.approx(np.trace(np.linalg.inv(C)), rel=1e-12)
    alpha = rng.normal(size=30)
    np.testing.assert_array_equal(CholeskyFactor(K, noise).mean_weights(alpha), alpha)


def test_appending_one_by_one_equals_factorising_at_once():
    K, noise = covariance(60, 3), 0.05
    grown = CholeskyFactor(K[:20, :20], noise)
    for n in range(20, 60):
        grown.append(K[:n, n], K[n, n])
    whole = CholeskyFactor(K, noise)
    assert grown.size == 60
    np.testing.assert_allclose(grown.whitener, whole.whitener, atol=1e-11)
    assert grown.log_determinant == pytest.approx(whole.log_determinant, abs=1e-11)


def test_a_copy_grows_alone():
    K = covariance(10, 4)
    first = CholeskyFactor(K[:8, :8], 0.1)
    before = first.whitener.copy()
    second = first.copy()
    second.append(K[:8, 8], K[8, 8])
    first.append(K[:8, 9], K[9, 9])
    assert (first.size, second.size) == (9, 9)
    np.testing.assert_array_equal(first.whitener[:8, :8], before)
    np.testing.assert_array_equal(second.whitener[:8, :8], before)
    assert not np.allclose(first.whitener[8], second.whitener[8])


def test_singular_matrices_get_the_smallest_jitter_that_serves():
    factor = CholeskyFactor(np.ones((20, 20)), 0.0)
    assert 0 < factor.jitter <= 1e-9
    assert CholeskyFactor(covariance(5, 5), 0.0).jitter == 0.0


def test_a_repeated_observation_without_noise_is_survived():
    factor = CholeskyFactor(np.eye(3), 0.0)
    factor.append(np.array([1.0, 0.0, 0.0]), 1.0)
    assert np.all(np.isfinite(factor.whitener))


@pytest.mark.parametrize("bad", [np.full((3, 3), np.nan), -np.eye(3)])
def test_hopeless_matrices_are_a_fault(bad):
    with pytest.raises(SystemFault, match="not positive definite"):
        CholeskyFactor(bad, 0.0)


def test_projection_is_the_nearest_semi_definite_matrix():
    K, noise = covariance(24, 6, definite=False), 0.2
    values, U = np.linalg.eigh(K)
    P = (U * np.maximum(values, 0)) @ U.T + noise * np.eye(24)
    factor = SpectralFactor(K, noise)
    rng = np.random.default_rng(7)
    b = rng.normal(size=24)
    np.testing.assert_allclose(factor.solve(b), np.linalg.solve(P, b), atol=1e-12)
    assert factor.smallest_eigenvalue == pytest.approx(values[0])
    assert factor.smallest_eigenvalue < -0.1
    kept = U[:, values > 0]
    b_kept = kept @ (kept.T @ b)
    white = factor.whiten(b[:, None])
    assert float((white**2).sum()) == pytest.approx(b_kept @ np.linalg.solve(P, b_kept))
    np.testing.assert_allclose(factor.mean_weights(b), b_kept, atol=1e-12)


def test_likelihood_weights_differentiate_through_the_projection():
    K, D = covariance(12, 8, definite=False), covariance(12, 9)
    r = np.random.default_rng(10).normal(size=12)

    def log_likelihood(t):
        factor = SpectralFactor(K + t[0] * D, 0.1)
        return -0.5 * (r @ factor.solve(r) + factor.log_determinant)

    factor = SpectralFactor(K, 0.1)
    got = 0.5 * np.vdot(factor.likelihood_weights(factor.solve(r)), D)
    expected = approx_fprime(np.zeros(1), log_likelihood, 1e-7)[0]
    assert got == pytest.approx(expected, rel=1e-5)
