"""Exact Gaussian process regression with Matern 5/2 (paper, section III; Alg. 1, lines 2-3).

Targets are standardised inside, the constant mean is profiled out of the likelihood, and every
solve is a product with the whitening matrix (see :mod:`.factorisation`), so that a batch of
queries costs matrix products only.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.optimise.distances import Distance
from gpis_grasp_planner.optimise.factorisation import CholeskyFactor, Factor, SpectralFactor
from gpis_grasp_planner.optimise.kernel import correlation, correlation_with_slopes
from gpis_grasp_planner.optimise.rprop import RpropSettings, maximise_rprop
from gpis_grasp_planner.settings import SettingsGroup, setting

Array = NDArray[np.float64]

QUERY_BLOCK = 512
"""Queries handled at a time: the block of cross covariances then stays in the cache."""


@dataclass(frozen=True)
class GaussianProcessSettings(SettingsGroup):
    """Parameters of the regression; standard deviations are relative to that of the targets."""

    noise_std_min: float = setting(
        1e-4, low=1e-6, high=1.0, description="Lower bound of the observation noise."
    )
    noise_std_max: float = setting(
        0.01,
        low=1e-6,
        high=10.0,
        description="Upper bound of the observation noise; raise it for objectives with noise.",
    )
    signal_std_min: float = setting(
        0.3, low=1e-3, high=10.0, description="Lower bound of the signal's standard deviation."
    )
    signal_std_max: float = setting(
        4.0, low=1e-2, high=100.0, description="Upper bound of the signal's standard deviation."
    )
    likelihood_observations: int = setting(
        160, low=5, high=5000, description="Observations the likelihood is maximised on, at most."
    )
    rprop_iterations: int = setting(
        25, low=1, high=1000, description="Gradients of the likelihood in one optimisation."
    )


class GaussianProcess:
    """Regression on feature vectors with a distance of one's choice.

    Parameters
    ----------
    distance : Distance
        An indefinite one (``definite`` False) is handled by projecting eigenvalues, at about
        twenty times the cost of a fit and without the incremental append.
    settings : GaussianProcessSettings, optional

    Attributes
    ----------
    log_parameters : (2 + n_scales,) array
        Logarithms of the signal variance, the noise variance (both of standardised targets) and
        the length scales.
    """

    def __init__(self, distance: Distance, settings: GaussianProcessSettings | None = None):
        self.distance = distance
        self.settings = settings or GaussianProcessSettings()
        s = self.settings
        scales = np.log(distance.scale_bounds)
        self.low = np.concatenate(
            [[2 * np.log(s.signal_std_min), 2 * np.log(s.noise_std_min)], scales[:, 0]]
        )
        self.high = np.concatenate(
            [[2 * np.log(s.signal_std_max), 2 * np.log(s.noise_std_max)], scales[:, 1]]
        )
        start = np.concatenate([[0.0, 2 * np.log(0.03)], scales.mean(axis=1)])
        self.log_parameters = np.clip(start, self.low, self.high)
        self.features = np.zeros((0, distance.n_features))
        self.targets = np.zeros(0)
        self._factor: Factor | None = None

    @property
    def n_observations(self) -> int:
        """Number of observations n."""
        return len(self.targets)

    @property
    def length_scales(self) -> Array:
        """Length scales (n_scales,) in the units of the features."""
        return np.exp(self.log_parameters[2:])

    @property
    def target_std(self) -> float:
        """Standard deviation of the targets, the unit of the model (1 where all are equal)."""
        return self._unit

    @property
    def noise_variance(self) -> float:
        """Observation noise in standardised units."""
        return float(np.exp(self.log_parameters[1]))

    @property
    def signal_variance(self) -> float:
        """Signal variance in standardised units."""
        return float(np.exp(self.log_parameters[0]))

    def fit(self, features: ArrayLike, targets: ArrayLike, optimise: bool = True) -> None:
        """Take observations (n, p) and (n,), and optimise the hyperparameters if asked to.

        Cost: O(n^3) once; optimising costs up to `rprop_iterations` times that, on at most
        `likelihood_observations`.
        """
        self.features, self.targets = self._checked(features, targets)
        if optimise:
            self.optimise_hyperparameters()
        self._factorise()
        self._weigh()

    def append(self, features: ArrayLike, targets: ArrayLike) -> None:
        """Add observations (k, p) and (k,) under the present hyperparameters. O(k n^2)."""
        new_features, new_targets = self._checked(features, targets)
        old = self.features
        self.features = np.vstack([old, new_features])
        self.targets = np.concatenate([self.targets, new_targets])
        if isinstance(self._factor, CholeskyFactor):
            cross = self.signal_variance * correlation(
                self.distance, self.features, new_features, self.length_scales
            )
            for j in range(len(new_targets)):
                self._factor.append(cross[: len(old) + j, j], self.signal_variance)
        else:
            self._factorise()
        self._weigh()

    def replace_targets(self, targets: ArrayLike) -> None:
        """Keep features and hyperparameters, take other targets (n,). O(n^2)."""
        _, self.targets = self._checked(self.features, targets)
        self._weigh()

    def copy(self) -> GaussianProcess:
        """A copy whose appends leave this one alone (for imagined observations)."""
        other = copy.copy(self)
        if isinstance(self._factor, CholeskyFactor):
            other._factor = self._factor.copy()
        return other

    def predict(self, features: ArrayLike) -> tuple[Array, Array]:
        """Posterior mean and standard deviation (m,) of the noise-free function.

        Cost: about n m p + n^2 m multiplications for m queries of p features.
        """
        features = np.asarray(features, dtype=float)
        mean, std = np.empty(len(features)), np.empty(len(features))
        factor, signal = self._ready(), self.signal_variance
        for start in range(0, len(features), QUERY_BLOCK):
            block = slice(start, start + QUERY_BLOCK)
            cross = correlation(self.distance, features[block], self.features, self.length_scales)
            mean[block] = self._mean + signal * (cross @ self._weights)
            white = factor.whiten(cross.T)
            reduction = np.einsum("ij,ij->j", white, white)
            # An indefinite kernel may exceed the prior even after the projection: cut at zero.
            std[block] = np.sqrt(np.maximum(signal - signal**2 * reduction, 0.0))
        return self._offset + self._unit * mean, self._unit * std

    def mean_and_whitened(self, features: Array) -> tuple[Array, Array]:
        """Posterior mean (m,), and V (n, m) with posterior covariance k(F, F) - V^T V.

        V is in standardised units; see :class:`.candidate_posterior.CandidatePosterior`.
        """
        factor, signal = self._ready(), self.signal_variance
        cross = signal * correlation(self.distance, features, self.features, self.length_scales)
        mean = self._offset + self._unit * (self._mean + cross @ self._weights)
        return mean, factor.whiten(cross.T)

    def predict_mean(self, features: ArrayLike) -> Array:
        """Posterior mean (m,) alone, O(n m)."""
        self._ready()
        cross = correlation(
            self.distance, np.asarray(features, dtype=float), self.features, self.length_scales
        )
        return self._offset + self._unit * (
            self._mean + self.signal_variance * (cross @ self._weights)
        )

    def log_likelihood(self, log_parameters: ArrayLike) -> tuple[float, Array]:
        """Log marginal likelihood of the standardised targets, and its gradient.

        Parameters
        ----------
        log_parameters : (2 + n_scales,) array_like
            In the order of the attribute of that name.

        Returns
        -------
        value : float
        gradient : (2 + n_scales,) array
            Analytic; the profiled constant mean does not enter it (its derivative is zero).
        """
        return self._likelihood(
            self.distance.parts(self.features),
            self._standardised(self.targets)[0],
            np.asarray(log_parameters, dtype=float),
        )

    def optimise_hyperparameters(self) -> None:
        """Maximise the likelihood by iRprop- from the present values (Alg. 1, line 3)."""
        if self.n_observations < 2:
            return
        # Evenly over the record. By value would be wrong: the lucky ones among noisy observations
        # of one place agree with each other, and the noise would be found too small.
        n = min(self.n_observations, self.settings.likelihood_observations)
        keep = np.linspace(0, self.n_observations - 1, n).astype(np.intp)
        parts = self.distance.parts(self.features[keep])
        z = self._standardised(self.targets[keep])[0]
        result = maximise_rprop(
            lambda p: self._likelihood(parts, z, p),
            self.log_parameters,
            self.low,
            self.high,
            RpropSettings(max_iterations=self.settings.rprop_iterations),
        )
        self.log_parameters = result.x
        self._factor = None

    def _likelihood(self, parts: Array, z: Array, p: Array) -> tuple[float, Array]:
        signal, noise = float(np.exp(p[0])), float(np.exp(p[1]))
        k, slopes = correlation_with_slopes(self.distance, parts, np.exp(p[2:]))
        K = signal * k
        factor = self._new_factor(K, noise)
        residual = z - _profiled_mean(factor, z)
        alpha = factor.solve(residual)
        value = -0.5 * (
            float(residual @ alpha) + factor.log_determinant + len(z) * np.log(2 * np.pi)
        )
        M = factor.likelihood_weights(alpha)
        inverse_trace = factor.inverse_trace
        gradient = np.concatenate(
            [
                [np.vdot(M, K), noise * (float(alpha @ alpha) - inverse_trace)],
                signal * np.tensordot(slopes, M, axes=2),
            ]
        )
        return value, 0.5 * gradient

    def _new_factor(self, K: Array, noise: float) -> CholeskyFactor | SpectralFactor:
        if self.distance.definite:
            return CholeskyFactor(K, noise)
        return SpectralFactor(K, noise)

    def _factorise(self) -> None:
        K = self.signal_variance * correlation(
            self.distance, self.features, self.features, self.length_scales
        )
        self._factor = self._new_factor(K, self.noise_variance)

    def _weigh(self) -> None:
        factor = self._ready()
        z, self._offset, self._unit = self._standardised(self.targets)
        self._mean = _profiled_mean(factor, z)
        self._weights = factor.mean_weights(factor.solve(z - self._mean))

    def _ready(self) -> Factor:
        if self._factor is None:
            if self.n_observations == 0:
                raise RequestError("The Gaussian process has no observations; call fit first.")
            self._factorise()
        assert self._factor is not None
        return self._factor

    def _checked(self, features: ArrayLike, targets: ArrayLike) -> tuple[Array, Array]:
        X = np.atleast_2d(np.asarray(features, dtype=float))
        y = np.atleast_1d(np.asarray(targets, dtype=float))
        if X.shape != (len(y), self.distance.n_features) or len(y) == 0:
            raise RequestError(
                f"Observations have features {X.shape} and targets {y.shape}; give (n, "
                f"{self.distance.n_features}) and (n,) with n of at least 1."
            )
        if not (np.all(np.isfinite(X)) and np.all(np.isfinite(y))):
            raise RequestError(
                "An observation is NaN or infinite; map failures to a finite bad value first."
            )
        return X, y

    @staticmethod
    def _standardised(y: Array) -> tuple[Array, float, float]:
        offset, unit = float(y.mean()), float(y.std())
        if unit <= 1e-12 * max(1.0, abs(offset)):
            unit = 1.0
        return (y - offset) / unit, offset, unit


def _profiled_mean(factor: Factor, z: Array) -> float:
    # Generalised least squares: the constant that maximises the likelihood at these parameters.
    solved = factor.solve(np.ones_like(z))
    return float(solved @ z) / float(solved.sum())
