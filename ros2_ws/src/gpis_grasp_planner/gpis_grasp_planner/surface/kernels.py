"""Covariance functions of the implicit surface, with the derivatives that normals need.

A normal is an observation of the gradient, so the Gaussian process is fitted to values and
gradients together. With ``d = x - x'`` and ``r = |d|`` every radial kernel ``k(r)`` used here
is written with two more scalars, ``b = -k'(r) / r`` and ``c = b'(r) / r``:

    cov(f(x),     f(x'))      = k
    cov(f(x),     df(x')/dx') =  b d^T
    cov(df(x)/dx, f(x'))      = -b d
    cov(df(x)/dx, df(x')/dx') =  b I + c d d^T

Both kernels are Matern functions, positive definite in every dimension; gradients may be
observed because they are twice differentiable at r = 0 (nu > 1), and the joint covariance of
values and gradients is again positive definite for distinct points. The thin plate kernel of the
older literature on implicit surfaces, ``2 r^3 - 3 R r^2 + R^3``, is definite only inside a ball of
radius R that must be known beforehand; Matern 3/2 has the same leading odd term r^3, hence the
same smoothness, without that condition. To the radial part a linear kernel ``s^2 (1 + x.x')``
(positive semi-definite) is added: an unknown constant and slope, so that far from the samples of a
patch the posterior goes on as a plane instead of falling back to zero.

A sum of positive definite functions plus noise on the diagonal is positive definite.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.compiled import njit

Array = NDArray[np.float64]

MATERN_32 = 0
MATERN_52 = 1
KERNELS = {"matern32": MATERN_32, "matern52": MATERN_52}


@njit(inline="always")
def radial(kind: int, a: float, r: float) -> tuple[float, float, float]:
    """Return ``k``, ``b`` and ``c`` of unit signal variance at distance `r` (see the module).

    Parameters
    ----------
    kind : int
        ``MATERN_32`` (then ``a = sqrt(3) / length_scale``) or ``MATERN_52`` (``sqrt(5)``).
    a : float
        Inverse length.
    r : float
        Distance, in the unit of ``1 / a``. At r = 0 Matern 3/2's ``c`` is unbounded, but
        ``c d d^T`` tends to zero; 0 is returned.
    """
    e = math.exp(-a * r)
    if kind == MATERN_32:
        c = -a * a * a * e / r if r > 0.0 else 0.0
        return (1.0 + a * r) * e, a * a * e, c
    a2 = a * a / 3.0
    return (1.0 + a * r + a2 * r * r) * e, a2 * (1.0 + a * r) * e, -a2 * a * a * e


def inverse_length(kernel: str, length_scale: float) -> float:
    """The `a` of :func:`radial` for a kernel's name and its length scale."""
    return math.sqrt(3.0 if KERNELS[kernel] == MATERN_32 else 5.0) / length_scale


def covariance(kind: int, a: float, variance: float, trend: float, p: Array, q: Array) -> Array:
    """Covariance of (value, gradient) at `p` with (value, gradient) at `q`.

    Parameters
    ----------
    kind, a : int, float
        As in :func:`radial`.
    variance, trend : float
        Signal variance of the radial part and ``s^2`` of the linear part.
    p, q : (n, 3), (m, 3) arrays

    Returns
    -------
    (4 n, 4 m) array
        Rows and columns ordered value, d/dx, d/dy, d/dz point by point.
    """
    K = np.empty((4 * len(p), 4 * len(q)))
    fill_covariance(kind, a, variance, trend, p, q, K)
    return K


@njit
def fill_covariance(
    kind: int, a: float, variance: float, trend: float, p: Array, q: Array, K: Array
) -> None:
    """Write :func:`covariance` into `K`, which saves fresh memory for every patch."""
    n, m = p.shape[0], q.shape[0]
    d = np.empty(3)
    for i in range(n):
        for j in range(m):
            dot = 0.0
            r2 = 0.0
            for t in range(3):
                d[t] = p[i, t] - q[j, t]
                r2 += d[t] * d[t]
                dot += p[i, t] * q[j, t]
            k, b, c = radial(kind, a, math.sqrt(r2))
            k, b, c = variance * k, variance * b, variance * c
            row, col = 4 * i, 4 * j
            K[row, col] = k + trend * (1.0 + dot)
            for t in range(3):
                K[row, col + 1 + t] = b * d[t] + trend * p[i, t]
                K[row + 1 + t, col] = -b * d[t] + trend * q[j, t]
                for u in range(3):
                    K[row + 1 + t, col + 1 + u] = c * d[t] * d[u]
                K[row + 1 + t, col + 1 + t] += b + trend


@njit
def fill_upper_covariance(
    kind: int, a: float, variance: float, trend: float, q: Array, K: Array
) -> None:
    """:func:`fill_covariance` of `q` with itself, above the diagonal (and on it) only.

    The same numbers at half the cost; what lies below the diagonal's blocks of `K` stays as it was.
    """
    n = q.shape[0]
    d = np.empty(3)
    for i in range(n):
        for j in range(i, n):
            dot = 0.0
            r2 = 0.0
            for t in range(3):
                d[t] = q[i, t] - q[j, t]
                r2 += d[t] * d[t]
                dot += q[i, t] * q[j, t]
            k, b, c = radial(kind, a, math.sqrt(r2))
            k, b, c = variance * k, variance * b, variance * c
            row, col = 4 * i, 4 * j
            K[row, col] = k + trend * (1.0 + dot)
            for t in range(3):
                K[row, col + 1 + t] = b * d[t] + trend * q[i, t]
                K[row + 1 + t, col] = -b * d[t] + trend * q[j, t]
                for u in range(3):
                    K[row + 1 + t, col + 1 + u] = c * d[t] * d[u]
                K[row + 1 + t, col + 1 + t] += b + trend
