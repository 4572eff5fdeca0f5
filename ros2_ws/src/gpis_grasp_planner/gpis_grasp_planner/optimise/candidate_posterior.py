"""The joint posterior over a fixed set of candidates, conditioned on imagined observations.

Choosing a batch of k points one after the other, each imagined to return the model's mean (the
"kriging believer"), leaves the mean as it is and shrinks the variance near the chosen point. Over
a fixed set of m candidates that is one rank-one update of O(n m) per choice, in place of a whole
new search under an extended process.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.optimise.gaussian_process import GaussianProcess
from gpis_grasp_planner.optimise.kernel import correlation

Array = NDArray[np.float64]


class CandidatePosterior:
    """Mean and standard deviation of m candidates, the latter shrinking with each belief.

    Parameters
    ----------
    process : GaussianProcess
    features : (m, p) array
    n_beliefs : int
        Most beliefs that will be added.

    Attributes
    ----------
    mean : (m,) array
        In the units of the targets.
    """

    def __init__(self, process: GaussianProcess, features: Array, n_beliefs: int):
        self._process = process
        self._features = features
        self.mean, white = process.mean_and_whitened(features)
        self._variance = process.signal_variance - np.einsum("ij,ij->j", white, white)
        self._white = white
        self._beliefs = np.empty((n_beliefs, len(features)))
        self._n_beliefs = 0

    @property
    def std(self) -> Array:
        """Standard deviation (m,) in the units of the targets."""
        return self._process.target_std * np.sqrt(np.maximum(self._variance, 0.0))

    def believe(self, index: int) -> None:
        """Condition on candidate `index` returning its mean. O(n m)."""
        process = self._process
        prior = process.signal_variance * correlation(
            process.distance,
            self._features,
            self._features[index : index + 1],
            process.length_scales,
        )
        believed = self._beliefs[: self._n_beliefs]
        covariance = prior[:, 0] - self._white[:, index] @ self._white
        covariance -= believed[:, index] @ believed
        pivot = max(float(self._variance[index]), 0.0) + process.noise_variance
        row = covariance / np.sqrt(pivot)
        self._variance = self._variance - row * row
        self._beliefs[self._n_beliefs] = row
        self._n_beliefs += 1
