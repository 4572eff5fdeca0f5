"""Bayesian logistic regression: probabilities of passing, learnt from counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ROUNDS = 30
_SETTLED = 1e-8


@dataclass(frozen=True, eq=False)
class Logistic:
    """``P(pass | x) = 1 / (1 + exp(-w x))`` with a normal prior over the weights.

    Attributes
    ----------
    mean : (f,) array
        Of the weights.
    precision : (f, f) array
        Inverse of their covariance.
    """

    mean: Array
    precision: Array

    def probability(self, x: Array) -> Array:
        """Of passing for features (..., f), at the weights' mean."""
        return np.asarray(1.0 / (1.0 + np.exp(-np.clip(x @ self.mean, -30.0, 30.0))))

    def updated(self, x: Array, passed: Array, n: Array) -> Logistic:
        """The posterior, as a normal about its maximum (Laplace's approximation).

        Parameters
        ----------
        x : (m, f) array
        passed, n : (m,) arrays
            How many of how many trials passed at each.

        Notes
        -----
        Newton's method on a concave function; steps are halved while they go too far. O(m f^2).
        """
        weights = self.mean.copy()
        value = self._log_posterior(weights, x, passed, n)
        for _ in range(_ROUNDS):
            p = 1.0 / (1.0 + np.exp(-np.clip(x @ weights, -30.0, 30.0)))
            slope = x.T @ (passed - n * p) - self.precision @ (weights - self.mean)
            step = np.linalg.solve(self._curvature(x, n, p), slope)
            if np.abs(step).max() < _SETTLED:
                break
            share = 1.0
            while (new := self._log_posterior(weights + share * step, x, passed, n)) < value:
                share *= 0.5
                if share < _SETTLED:
                    break
            weights, value = weights + share * step, new
        p = 1.0 / (1.0 + np.exp(-np.clip(x @ weights, -30.0, 30.0)))
        return Logistic(weights, self._curvature(x, n, p))

    def _curvature(self, x: Array, n: Array, p: Array) -> Array:
        return np.asarray(self.precision + (x * (n * p * (1.0 - p))[:, None]).T @ x)

    def _log_posterior(self, weights: Array, x: Array, passed: Array, n: Array) -> float:
        logit, off = x @ weights, weights - self.mean
        likelihood = passed @ logit - n @ np.logaddexp(0.0, logit)
        return float(likelihood - 0.5 * off @ self.precision @ off)
