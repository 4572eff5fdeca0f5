"""Matern covariance with nu = 5/2 (paper, section III), and its derivatives by the logarithms.

    k(d) = sigma^2 (1 + sqrt(5) d + 5 d^2 / 3) exp(-sqrt(5) d)

with d already divided by the length scales (the paper's d / rho).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.optimise.distances import Distance

Array = NDArray[np.float64]

SQRT5 = float(np.sqrt(5.0))


def matern52(distance: Array) -> Array:
    """Correlation at scaled distances of any shape; overwrites `distance` as work space.

    In place because at 300 x 2000 the temporaries cost more than the exponential.
    """
    distance *= SQRT5
    polynomial = distance / 3.0
    polynomial += 1.0
    polynomial *= distance
    polynomial += 1.0
    np.negative(distance, out=distance)
    np.exp(distance, out=distance)
    distance *= polynomial
    return distance


def correlation(distance: Distance, A: Array, B: Array, scales: Array) -> Array:
    """Matern 5/2 correlation (n, m) of features (n, p) and (m, p)."""
    return matern52(distance.matrix(A, B, scales))


def correlation_with_slopes(distance: Distance, parts: Array, scales: Array) -> tuple[Array, Array]:
    """Correlation (n, n) and its derivatives by each log length scale (n_scales, n, n).

    With dk/dd = -(5/3) d (1 + sqrt(5) d) exp(-sqrt(5) d) the factor d cancels the 1/d of the
    norm's derivative, so that coincident points need no care.
    """
    d, slopes = distance.slopes(parts, scales)
    decay = np.exp(-SQRT5 * d)
    factor = (5.0 / 3.0) * (1.0 + SQRT5 * d) * decay
    k = (1.0 + SQRT5 * d + (5.0 / 3.0) * d * d) * decay
    return k, slopes * factor
