"""Bayesian logistic regression: known answers at both ends, and the maximum found independently."""

import numpy as np
from scipy.optimize import minimize

from gpis_grasp_planner.verification.logistic import Logistic

SEED = 7


def counts(weights, m, n, rng):
    x = np.column_stack([np.ones(m), rng.normal(size=(m, len(weights) - 1))])
    return (
        x,
        rng.binomial(n, 1.0 / (1.0 + np.exp(-x @ weights))).astype(float),
        np.full(m, float(n)),
    )


def test_without_trials_the_prior_stays():
    prior = Logistic(np.array([0.3, -1.2]), np.array([[2.0, 0.4], [0.4, 1.0]]))
    same = prior.updated(np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    np.testing.assert_array_equal(same.mean, prior.mean)
    np.testing.assert_array_equal(same.precision, prior.precision)


def test_with_many_trials_the_truth_is_found_within_the_stated_error():
    rng = np.random.default_rng(SEED)
    truth = np.array([0.5, 2.0, -1.0])
    prior = Logistic(np.zeros(3), 0.01 * np.eye(3))
    found = prior.updated(*counts(truth, 400, 50, rng))
    deviation = np.sqrt(np.diag(np.linalg.inv(found.precision)))
    assert (deviation < 0.05).all()
    assert (np.abs(found.mean - truth) < 4.0 * deviation).all(), f"seed {SEED}"


def test_the_maximum_is_that_of_another_method():
    rng = np.random.default_rng(SEED)
    prior = Logistic(np.array([1.0, 0.5]), np.array([[3.0, 0.2], [0.2, 0.7]]))
    x, passed, n = counts(np.array([-2.0, 3.0]), 6, 4, rng)

    def cost(w):
        p = 1.0 / (1.0 + np.exp(-x @ w))
        off = w - prior.mean
        return -np.sum(passed * np.log(p) + (n - passed) * np.log(1 - p)) + 0.5 * off @ (
            prior.precision @ off
        )

    best = minimize(cost, prior.mean, method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-12})
    np.testing.assert_allclose(prior.updated(x, passed, n).mean, best.x, atol=1e-5)


def test_learning_in_two_parts_comes_near_learning_at_once():
    rng = np.random.default_rng(SEED)
    prior = Logistic(np.zeros(2), np.eye(2))
    x, passed, n = counts(np.array([0.2, 1.0]), 60, 20, rng)
    at_once = prior.updated(x, passed, n)
    parts = prior.updated(x[:30], passed[:30], n[:30]).updated(x[30:], passed[30:], n[30:])
    np.testing.assert_allclose(parts.mean, at_once.mean, atol=0.02)


def test_separable_trials_give_finite_weights():
    x = np.array([[1.0, -1.0], [1.0, 1.0]])
    found = Logistic(np.zeros(2), 0.1 * np.eye(2)).updated(
        x, np.array([0.0, 50.0]), np.array([50.0, 50.0])
    )
    assert np.isfinite(found.mean).all()
    low, high = found.probability(x)
    assert low < 0.1 < 0.9 < high
