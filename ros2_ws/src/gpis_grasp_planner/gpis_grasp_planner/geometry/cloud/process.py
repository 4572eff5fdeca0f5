"""The Gaussian process of a cloud: values and gradients under a Matern kernel about a prior mean.

With ``d = x - x'``, ``r = |d|`` and ``a = sqrt(3) / length`` the kernel (nu = 3/2) is

    k = s^2 (1 + a r) exp(-a r),   s = slope / a

where `slope` is the standard deviation of a component of the gradient about that of the prior mean.
Where nobody looked the process goes back to the prior mean within a length; the thin plate kernel
of O. Williams and A. Fitzgibbon, "Gaussian process implicit surfaces", 2007, goes on as a plane
there, and a rim's noisy normals then decide the whole back. A normal is an observation of the
gradient; with ``b = -k'(r) / r = slope^2 exp(-a r)`` and ``c = b'(r) / r = -a b / r``

    cov(f(x), f(x')) = k,  cov(f(x), df(x')/dx') = b d^T,  cov(df(x)/dx, df(x')/dx') = b I + c d d^T
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.errors import ErrorCode, MeshError

Array = NDArray[np.float64]

_JITTER = (0.0, 1e-10, 1e-8, 1e-6)


@dataclass(frozen=True)
class Kernel:
    """Length of the kernel, and standard deviation of the slopes about the prior's."""

    length: float
    slope: float

    @property
    def scalars(self) -> tuple[float, float]:
        """The inverse length ``a``, and ``slope^2``."""
        return math.sqrt(3.0) / self.length, self.slope**2


@njit(inline="always")
def matern(a: float, s2: float, r: float) -> tuple[float, float, float]:
    """Return ``k``, ``b`` and ``c`` at distance `r`; c is infinite at 0, where d is 0."""
    b = s2 * math.exp(-a * r)
    return b * (1.0 + a * r) / (a * a), b, (-a * b / r if r > 0.0 else 0.0)


@njit
def fill_covariance(a: float, s2: float, x: Array, K: Array) -> None:
    """Covariance (4n, 4n) of values and gradients at points (n, 3): value, x, y, z of each."""
    n = x.shape[0]
    d = np.empty(3)
    for i in range(n):
        for j in range(i + 1):
            r2 = 0.0
            for t in range(3):
                d[t] = x[i, t] - x[j, t]
                r2 += d[t] * d[t]
            k, b, c = matern(a, s2, math.sqrt(r2))
            K[4 * i, 4 * j] = k
            for t in range(3):
                K[4 * i, 4 * j + 1 + t] = b * d[t]
                K[4 * i + 1 + t, 4 * j] = -b * d[t]
                for u in range(3):
                    K[4 * i + 1 + t, 4 * j + 1 + u] = c * d[t] * d[u] + (b if t == u else 0.0)


@njit
def posterior_shift(a: float, s2: float, x: Array, weights: Array, queries: Array) -> Array:
    """What the weights (n, 4) add to the prior mean at queries (m, 3): (m,)."""
    out = np.zeros(queries.shape[0])
    for q in range(queries.shape[0]):
        total = 0.0
        for i in range(x.shape[0]):
            d0 = queries[q, 0] - x[i, 0]
            d1 = queries[q, 1] - x[i, 1]
            d2 = queries[q, 2] - x[i, 2]
            k, b, _ = matern(a, s2, math.sqrt(d0 * d0 + d1 * d1 + d2 * d2))
            slope = weights[i, 1] * d0 + weights[i, 2] * d1 + weights[i, 3] * d2
            total += weights[i, 0] * k + b * slope
        out[q] = total
    return out


@njit
def observed_covariance(a: float, s2: float, x: Array, y: Array) -> Array:
    """Covariance (4n, m) of values and gradients at points (n, 3) with values at (m, 3)."""
    K = np.empty((4 * x.shape[0], y.shape[0]))
    d = np.empty(3)
    for i in range(x.shape[0]):
        for j in range(y.shape[0]):
            r2 = 0.0
            for t in range(3):
                d[t] = x[i, t] - y[j, t]
                r2 += d[t] * d[t]
            k, b, _ = matern(a, s2, math.sqrt(r2))
            K[4 * i, j] = k
            for t in range(3):
                K[4 * i + 1 + t, j] = -b * d[t]
    return K


@njit
def value_covariance(a: float, s2: float, x: Array, y: Array) -> Array:
    """Covariance (n, m) of the values at points (n, 3) and (m, 3)."""
    K = np.empty((x.shape[0], y.shape[0]))
    for i in range(x.shape[0]):
        for j in range(y.shape[0]):
            r2 = 0.0
            for t in range(3):
                r2 += (x[i, t] - y[j, t]) ** 2
            K[i, j] = matern(a, s2, math.sqrt(r2))[0]
    return K


@dataclass(frozen=True, eq=False)
class Observations:
    """What is known of a signed distance f, in some unit of length.

    Attributes
    ----------
    points : (n, 3) array
        Where f is 0, give or take the noise.
    normals_outward : (n, 3) array
        Its gradients there.
    noise : (n,) array
        Standard deviations of the values.
    noise_normal : float
        Standard deviation of a normal's component (about radians).
    """

    points: Array
    normals_outward: Array
    noise: Array
    noise_normal: float


@dataclass(frozen=True, eq=False)
class Posterior:
    """The process after what was seen.

    Attributes
    ----------
    kernel : Kernel
    points : (n, 3) array
    factor : (4n, 4n) array
        Lower Cholesky factor of the observations' covariance.
    weights : (n, 4) array
        Of values and gradients: ``(K + noise)^-1 (y - prior mean)``.
    """

    kernel: Kernel
    points: Array
    factor: Array
    weights: Array

    @staticmethod
    def of(kernel: Kernel, seen: Observations, mean: Array, slope: Array) -> Posterior:
        """The posterior; the cost grows with n^3 (0.2 s for 600 on one core).

        Parameters
        ----------
        kernel : Kernel
        seen : Observations
        mean, slope : (n,), (n, 3) arrays
            The prior mean and its gradient at the points.

        Raises
        ------
        MeshError
            MESH_DEGENERATE for a covariance that no jitter makes definite.
        """
        from scipy.linalg import cho_solve

        n = len(seen.points)
        K = np.empty((4 * n, 4 * n))
        points = np.ascontiguousarray(seen.points)
        fill_covariance(*kernel.scalars, points, K)
        y = np.concatenate([-mean[:, None], seen.normals_outward - slope], axis=1)
        noise = np.full((n, 4), seen.noise_normal**2)
        noise[:, 0] = seen.noise**2
        factor = cholesky(K, noise.reshape(-1))
        weights = np.asarray(cho_solve((factor, True), y.reshape(-1))).reshape(n, 4)
        return Posterior(kernel, points, factor, weights)

    def shift(self, x: Array) -> Array:
        """What the mean (m,) at points (m, 3) is beyond the prior's: some 5 us a point."""
        x = np.ascontiguousarray(x)
        return np.asarray(posterior_shift(*self.kernel.scalars, self.points, self.weights, x))

    def covariance(self, x: Array) -> Array:
        """Covariance (m, m) of the values at points (m, 3)."""
        half = self._half(x)
        return np.asarray(value_covariance(*self.kernel.scalars, x, x) - half.T @ half)

    def deviation(self, x: Array) -> Array:
        """Standard deviation (m,) of the values at points (m, 3); 1 ms each for n = 600."""
        half = self._half(x)
        prior = float(value_covariance(*self.kernel.scalars, x[:1], x[:1])[0, 0])
        return np.sqrt((prior - np.einsum("ij,ij->j", half, half)).clip(0.0))

    def _half(self, x: Array) -> Array:
        from scipy.linalg import solve_triangular

        cross = observed_covariance(*self.kernel.scalars, self.points, np.ascontiguousarray(x))
        return np.asarray(solve_triangular(self.factor, cross, lower=True, check_finite=False))


def cholesky(K: Array, noise: Array) -> Array:
    """Lower factor of a covariance (its lower half) with noise (n,) on the diagonal; K changes."""
    from scipy.linalg import LinAlgError, cholesky

    scale = float(np.diag(K).mean())
    diagonal = np.diag(K) + noise
    for jitter in _JITTER:
        np.fill_diagonal(K, diagonal + jitter * scale)
        try:
            return np.asarray(cholesky(K, lower=True, check_finite=False))
        except LinAlgError:
            continue
    raise MeshError(
        f"The covariance of {len(K)} observations of the cloud is not positive definite. Remove "
        "points that are there twice, or give a larger noise (catalogue.cloud_noise_m).",
        ErrorCode.MESH_DEGENERATE,
    )
