"""The probability that a point is feasible, learnt from which points were.

Where a constraint forbids a point there is no value to learn from; taken for 0 it would pull the
model of the values down beside it, where the best points often are. So values and feasibility have
models of their own, and expected improvement is multiplied by the probability (Gelbart, Snoek and
Adams, Bayesian optimization with unknown constraints, UAI 2014, eq. 7). As there, feasible is where
a latent function is above its middle; it is a Gaussian process through 1 and 0, by regression in
place of their classification, with the value model's own length scales.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from gpis_grasp_planner.optimise.distances import Distance
from gpis_grasp_planner.optimise.gaussian_process import GaussianProcess

Array = NDArray[np.float64]

_MOST = 240
_LEAST = 1e-4
_NOISE_STD = 0.1  # of the standardised latent function


class FeasibilityModel:
    """Which points are feasible, by place.

    Parameters
    ----------
    distance : Distance
        Of the features.
    """

    def __init__(self, distance: Distance):
        self._process = GaussianProcess(distance)
        self._features = np.zeros((0, distance.n_features))
        self._feasible = np.zeros(0, dtype=np.bool_)
        self._fitted: bytes | None = None  # length scales of the fit

    @property
    def is_certain(self) -> bool:
        """Whether nothing infeasible was seen: all probabilities are 1."""
        return bool(self._feasible.all())

    def tell(self, features: Array, feasible: NDArray[np.bool_]) -> None:
        """Take points by their features (n, p)."""
        self._features = np.vstack([self._features, features])
        self._feasible = np.concatenate([self._feasible, feasible])
        if len(self._feasible) > 2 * _MOST:  # evenly over the record: it is dense where it matters
            keep = np.linspace(0, len(self._feasible) - 1, _MOST).astype(np.intp)
            self._features, self._feasible = self._features[keep], self._feasible[keep]
        self._fitted = None

    def probability(self, features: Array, length_scales: Array) -> Array:
        """Probability (m,) of being feasible at features (m, p), at least 1e-4.

        A fit of up to 480 points (some ms) where something was told since the last call.
        """
        if self.is_certain:
            return np.ones(len(features))
        scales = np.asarray(length_scales).tobytes()
        if self._fitted != scales:
            logs = [0.0, 2.0 * np.log(_NOISE_STD), *np.log(length_scales)]
            self._process.log_parameters = np.array(logs)
            self._process.fit(self._features, self._feasible.astype(float), optimise=False)
            self._fitted = scales
        mean, std = self._process.predict(features)
        return np.maximum(ndtr((mean - 0.5) / np.maximum(std, 1e-9)), _LEAST)
