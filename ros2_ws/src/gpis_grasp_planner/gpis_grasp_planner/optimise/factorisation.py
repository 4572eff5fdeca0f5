"""Whitening of covariance matrices: W with W C W^T = I, so that a solve is a matrix product.

Two ways. :class:`CholeskyFactor` serves proven covariances: W = L^-1, appended to in O(n^2).
:class:`SpectralFactor` serves the paper's indefinite kernel: negative eigenvalues are set to zero
("spectrum clip") and the cross covariances are projected to the same subspace, which keeps the
predictive mean consistent between training and query points.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import blas, cholesky, lapack

from gpis_grasp_planner.errors import SystemFault

Array = NDArray[np.float64]

JITTERS = (0.0, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4)
"""Ladder of relative jitters, tried in order until the Cholesky factor exists."""


class Factor(Protocol):
    """A factorised covariance C = K + noise I."""

    @property
    def size(self) -> int:
        """Number of rows n."""
        ...

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of C."""
        ...

    @property
    def inverse_trace(self) -> float:
        """Trace of C^-1."""
        ...

    def whiten(self, cross: Array) -> Array:
        """W times `cross` (n, m); the squared norm of its columns is k^T C^-1 k."""
        ...

    def solve(self, vector: Array) -> Array:
        """C^-1 times `vector` (n,)."""
        ...

    def mean_weights(self, alpha: Array) -> Array:
        """Weights (n,) of the cross covariances in the predictive mean."""
        ...

    def likelihood_weights(self, alpha: Array) -> Array:
        """M (n, n) with dL/dtheta = sum(M * dK/dtheta) / 2, where alpha = C^-1 r."""
        ...


class CholeskyFactor:
    """Cholesky whitening of a positive definite matrix.

    Parameters
    ----------
    K : (n, n) array
        Covariance without noise.
    noise : float
        Variance added to the diagonal.

    Raises
    ------
    SystemFault
        If no jitter of the ladder makes the matrix positive definite.
    """

    def __init__(self, K: Array, noise: float):
        n = len(K)
        self._n = n
        self._buffer = np.zeros((n, n), order="F")
        self.jitter = 0.0
        self._noise = noise
        scale = float(np.mean(np.diag(K))) if n else 1.0
        for relative in JITTERS:
            C = K.copy()
            C[np.diag_indices(n)] += noise + relative * scale
            try:
                L = cholesky(C, lower=True, overwrite_a=True, check_finite=False)
            except np.linalg.LinAlgError:
                continue
            # LAPACK lets NaN through.
            if not np.all(np.isfinite(np.diag(L))):
                continue
            self.jitter = relative * scale
            self._log_det = 2.0 * float(np.log(np.diag(L)).sum())
            inverse, _ = lapack.dtrtri(L, lower=1)
            self._buffer[:] = np.tril(inverse)
            return
        raise SystemFault(
            f"A covariance of {n} observations is not positive definite even with a relative "
            f"jitter of {JITTERS[-1]:g}; its entries are probably not finite. Check the features."
        )

    @property
    def size(self) -> int:
        """Number of rows n."""
        return self._n

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of C."""
        return self._log_det

    @property
    def inverse_trace(self) -> float:
        """Trace of C^-1: the squared Frobenius norm of W."""
        return float(np.vdot(self.whitener, self.whitener))

    @property
    def whitener(self) -> Array:
        """W = L^-1, lower triangular (n, n); a view."""
        return self._buffer[: self._n, : self._n]

    def copy(self) -> CholeskyFactor:
        """An independent copy, for observations that are only imagined."""
        other = object.__new__(CholeskyFactor)
        other.__dict__.update(self.__dict__)
        other._buffer = np.array(self.whitener, order="F")
        return other

    def whiten(self, cross: Array) -> Array:
        """W times `cross` (n, m), by the triangular product: half the cost of the full one.

        A Fortran-ordered `cross` (the transpose of a C-ordered one) is not copied first.
        """
        return blas.dtrmm(1.0, np.asfortranarray(self.whitener), cross, lower=1)

    def solve(self, vector: Array) -> Array:
        """C^-1 times `vector` (n,). O(n^2)."""
        W = self.whitener
        return W.T @ (W @ vector)

    def mean_weights(self, alpha: Array) -> Array:
        """Alpha itself."""
        return alpha

    def append(self, cross: Array, variance: float) -> None:
        """Add one observation in O(n^2).

        Parameters
        ----------
        cross : (n,) array
            Covariances with the present observations.
        variance : float
            The new observation's prior variance (without noise).
        """
        n = self._n
        row = self.whitener @ cross
        floor = 1e-10 * (variance + self._noise)
        pivot = np.sqrt(max(variance + self._noise + self.jitter - float(row @ row), floor))
        if n == len(self._buffer):
            larger = np.zeros((n + n // 2 + 16,) * 2, order="F")
            larger[:n, :n] = self._buffer[:n, :n]
            self._buffer = larger
        self._buffer[n, :n] = -(row @ self.whitener) / pivot
        self._buffer[n, n] = 1.0 / pivot
        self._n = n + 1
        self._log_det += 2.0 * float(np.log(pivot))

    def likelihood_weights(self, alpha: Array) -> Array:
        """Outer product of alpha minus C^-1."""
        W = self.whitener
        return np.outer(alpha, alpha) - W.T @ W


class SpectralFactor:
    """Eigenvalue projection of a matrix that need not be positive semi-definite.

    Parameters are those of :class:`CholeskyFactor`. Cost: one symmetric eigenproblem, about
    twenty Cholesky factors; there is no append.
    """

    def __init__(self, K: Array, noise: float):
        eigenvalues, self._U = np.linalg.eigh(K)
        self.smallest_eigenvalue = float(eigenvalues[0]) if len(K) else 0.0
        self._raw = eigenvalues
        # The floor keeps the determinant finite where the noise is zero.
        self._floor = max(noise, 1e-10)
        self._values = np.maximum(eigenvalues, 0.0) + self._floor

    @property
    def size(self) -> int:
        """Number of rows n."""
        return len(self._values)

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of the projected matrix plus noise."""
        return float(np.log(self._values).sum())

    @property
    def inverse_trace(self) -> float:
        """Trace of the inverse of the projected matrix plus noise."""
        return float((1.0 / self._values).sum())

    def whiten(self, cross: Array) -> Array:
        """W times the projection of `cross` (n, m) onto the kept eigenvectors."""
        kept = self._raw > 0.0
        return (self._U[:, kept].T @ cross) / np.sqrt(self._values[kept])[:, None]

    def solve(self, vector: Array) -> Array:
        """Solve with the projected matrix plus noise."""
        return self._U @ ((self._U.T @ vector) / self._values)

    def mean_weights(self, alpha: Array) -> Array:
        """Remove the dropped eigenvectors, which the cross covariances do not have either."""
        kept = self._U[:, self._raw > 0.0]
        return kept @ (kept.T @ alpha)

    def likelihood_weights(self, alpha: Array) -> Array:
        """Weights through the projection, by the Daleckii-Krein formula.

        d clip(K) = U (F o (U^T dK U)) U^T, where F holds the divided differences of
        max(x, 0) over the eigenvalues; moved to the other factor of the trace.
        """
        U, raw = self._U, self._raw
        clipped = np.maximum(raw, 0.0)
        difference = raw[:, None] - raw[None, :]
        close = np.abs(difference) <= 1e-12 * max(1.0, float(np.abs(raw).max(initial=0.0)))
        both = (raw[:, None] > 0.0) & (raw[None, :] > 0.0)
        F = np.where(
            close, both, (clipped[:, None] - clipped[None, :]) / np.where(close, 1.0, difference)
        )
        inner = U.T @ np.outer(alpha, alpha) @ U - np.diag(1.0 / self._values)
        return U @ (F * inner) @ U.T
