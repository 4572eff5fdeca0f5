"""A cheap stand-in for the wrench space's volume, for the planner's inner loop.

The wrenches are brought into the frame in which their inertia ellipsoid is the unit ball. There
the hull's shape is told by its support function in 48 fixed directions, six axes of four random
frames and their opposites; back in the old frame the volume grows by the ellipsoid's. The
ellipsoid alone is not enough: contacts that crowd in two places, as on an edge between finger and
palm, make it large without making the hull large, and a search that believes it collects such
grasps (up to seven times too large; now two times).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.compiled import njit

_FRAMES = 4
# Fitted to the exact volumes of 786 planned grasps of nine objects: log volume = log c
# + log ellipsoid + a log k + b 6 mean log h, root of the mean squared error 0.20.
_FACTOR = 0.50
_PER_CONTACT = 0.47
_PER_SUPPORT = 0.83


def _directions() -> NDArray[np.float64]:
    """Unit vectors (48, 6), evenly around the origin."""
    rng = np.random.default_rng(0)
    axes = np.concatenate([np.linalg.qr(rng.normal(size=(6, 6)))[0] for _ in range(_FRAMES)])
    return np.concatenate([axes, -axes])


_DIRECTIONS = _directions()


@njit
def volume_estimate(W, k):  # type: ignore[no-untyped-def]
    """Estimate of the volume of the hull of wrenches W (n, 6) of k contacts; 0 if they are flat.

    Some 6 us for eight contacts. Within a factor of 1.5 in 95 of 100 planned grasps. Ranking and
    answers use the exact volume.
    """
    n = W.shape[0]
    L = np.zeros((6, 6))
    ellipsoid = _ellipsoid(W, L)
    if ellipsoid == 0.0:
        return 0.0
    log_support = 0.0
    d = np.empty(6)
    for j in range(_DIRECTIONS.shape[0]):
        # L^T d = u: the support of the whitened wrenches along u is that of W along d.
        for a in range(5, -1, -1):
            s = _DIRECTIONS[j, a]
            for b in range(a + 1, 6):
                s -= L[b, a] * d[b]
            d[a] = s / L[a, a]
        support = 1e-3
        for i in range(n):
            along = 0.0
            for a in range(6):
                along += W[i, a] * d[a]
            support = along if along > support else support
        log_support += np.log(support)
    mean = log_support / _DIRECTIONS.shape[0]
    return _FACTOR * ellipsoid * k**_PER_CONTACT * np.exp(_PER_SUPPORT * 6.0 * mean)


@njit
def _ellipsoid(W, L):  # type: ignore[no-untyped-def]
    """Cholesky's L of the wrenches' mean outer product; its determinant, or 0 if they are flat."""
    n = W.shape[0]
    for i in range(n):
        for a in range(6):
            for b in range(a + 1):
                L[a, b] += W[i, a] * W[i, b] / n
    flat = 0.0
    for a in range(6):
        flat = max(flat, 1e-12 * L[a, a])
    determinant = 1.0
    for b in range(6):
        for c in range(b):
            for a in range(b, 6):
                L[a, b] -= L[a, c] * L[b, c]
        if L[b, b] <= flat:
            return 0.0
        pivot = np.sqrt(L[b, b])
        for a in range(b, 6):
            L[a, b] /= pivot
        determinant *= pivot
    return determinant
