"""Expected improvement (paper, section III), and its logarithm."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import erfcx, ndtr

Array = NDArray[np.float64]

_SQRT_2PI = float(np.sqrt(2.0 * np.pi))
_LOG_SQRT_2PI = float(np.log(_SQRT_2PI))


def expected_improvement(
    mean: ArrayLike, std: ArrayLike, best: ArrayLike, xi: float = 0.0
) -> Array:
    """Expected improvement of a maximisation, as printed in the paper.

    EI = 1(sigma) ((mu - best - xi) Phi(Z) + sigma phi(Z)), Z = 1(sigma) (mu - best - xi) / sigma,
    where the indicator 1(s) is 0 for s <= 0 and 1 otherwise: no uncertainty, no improvement.

    Parameters
    ----------
    mean, std : (n,) array_like
        Posterior mean and standard deviation.
    best : float or (n,) array_like
        Best observation so far; where it differs over the domain, what each point has to beat.
    xi : float
        Margin in the units of `mean`; larger explores more.

    Returns
    -------
    (n,) array
    """
    mean, std = np.asarray(mean, dtype=float), np.asarray(std, dtype=float)
    known = std <= 0.0
    gain = mean - np.asarray(best, dtype=float) - xi
    z = np.where(known, 0.0, gain / np.where(known, 1.0, std))
    density = np.exp(-0.5 * z * z) / _SQRT_2PI
    return np.where(known, 0.0, np.maximum(gain * ndtr(z) + std * density, 0.0))


def log_expected_improvement(
    mean: ArrayLike, std: ArrayLike, best: ArrayLike, xi: float = 0.0
) -> Array:
    """Logarithm of the expected improvement, exact where the improvement itself underflows.

    The maximiser is the same; far from the incumbent it still has a slope to climb. -inf where
    std <= 0. Parameters as in :func:`expected_improvement`.
    """
    mean, std = np.asarray(mean, dtype=float), np.asarray(std, dtype=float)
    known = std <= 0.0
    safe = np.where(known, 1.0, std)
    z = (mean - np.asarray(best, dtype=float) - xi) / safe
    return np.where(known, -np.inf, np.log(safe) + _log_h(z))


def _log_h(z: Array) -> Array:
    """log(phi(z) + z Phi(z)), in three ranges."""
    z = np.asarray(z, dtype=float)
    near = z > -1.0
    z_near = np.where(near, z, 0.0)
    direct = np.log(np.exp(-0.5 * z_near**2) / _SQRT_2PI + z_near * ndtr(z_near))
    z_far = np.where(near, -1.0, z)
    # phi (1 + z Phi/phi): the bracket tends to 1/z^2 and loses digits like z^2, so below -1000
    # its series takes over (error below 2e-11 there).
    ratio = np.sqrt(np.pi / 2.0) * erfcx(-z_far / np.sqrt(2.0))
    inverse = 1.0 / z_far**2
    series = inverse * (1.0 - 3.0 * inverse)
    bracket = np.where(z_far < -1e3, series, 1.0 + z_far * ratio)
    far = -0.5 * z_far**2 - _LOG_SQRT_2PI + np.log(np.maximum(bracket, 1e-300))
    return np.where(near, direct, far)
