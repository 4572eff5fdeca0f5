"""Epsilon without the convex hull, for the planner's inner loop (compiled, some 0.1 ms).

The hull P = conv(w_1 .. w_n) contains the origin exactly if its polar
``P* = {v : w_i . v <= 1 for all i}`` is bounded, and the facets of P are the vertices of P*: the
facet ``{x : v . x = 1}`` lies at distance 1/|v| from the origin. So epsilon = 1 / max |v| over
the vertices of P*. The maximum of a convex function over a polytope is found here by local
search: from the directions in which the support function is smallest, run along P* to a vertex,
then pivot to the adjacent vertex of largest norm until none is larger.

- An edge of P* that no constraint ends proves that the origin is not inside: the answer is -1.
- Otherwise every vertex visited is a facet of P, so the result is an upper bound of epsilon that
  is exact unless all starts missed the nearest facet. Compared with the exact hull on random
  grasps this happens in under one of a hundred (``tests/quality/test_fast_epsilon.py``);
  finalists are computed by ``wrench_space.hull_quality``.

The support-function view is that of Y. Zheng, "An efficient algorithm for a grasp quality
measure" (IEEE T-RO 2013), which expands an inner polytope instead and is exact; the pivoting is
simpler in six dimensions and needs no facets of its own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.lanes import LANES, filled, lowest_along, nearest_stop

Array = NDArray[np.float64]

_PIVOTS = 48
_TOLERANCE = 1e-9


def start_directions(n: int, seed: int = 0) -> Array:
    """Unit directions (n, 6) for :func:`fast_epsilon`; the same for every call of one planner."""
    u = np.random.default_rng(seed).normal(size=(n, 6))
    return np.asarray(u / np.linalg.norm(u, axis=1, keepdims=True))


@njit(allocates=False)
def _orthogonal(d, basis, k):  # type: ignore[no-untyped-def]
    """Take from d (6,) its part along the first k rows of an orthonormal basis, twice."""
    for _ in range(2):
        for j in range(k):
            dot = 0.0
            for c in range(6):
                dot += basis[j, c] * d[c]
            for c in range(6):
                d[c] -= dot * basis[j, c]


@njit(allocates=False)
def _norm(d):  # type: ignore[no-untyped-def]
    squared = 0.0
    for c in range(6):
        squared += d[c] * d[c]
    return np.sqrt(squared)


@njit
def _run_to_vertex(columns, u, v, active, A_inv, slack, rates):  # type: ignore[no-untyped-def]
    """From v = 0 along u into a vertex of the polar.

    On success (0) `v` is the vertex, `active` its six constraints and `A_inv` the inverse of their
    rows; 1 where the polar is unbounded, 2 where the rows depend on each other. Directions are kept
    orthogonal to the active rows by Gram-Schmidt.
    """
    n = columns.shape[1]
    basis = np.zeros((6, 6))
    d = np.empty(6)
    row = np.empty(6)
    for c in range(6):
        v[c] = 0.0
        d[c] = u[c]
    for i in range(n):
        slack[i] = 1.0
    for k in range(6):
        _orthogonal(d, basis, k)
        norm = _norm(d)
        if norm < 1e-10:
            return 2
        for c in range(6):
            d[c] /= norm
        way = (d[0], d[1], d[2], d[3], d[4], d[5])
        index, best = nearest_stop(columns, n, way, slack, rates)
        if best == np.inf:
            return 1
        for c in range(6):
            v[c] += best * d[c]
        for i in range(n):
            slack[i] = max(slack[i] - best * rates[i], 0.0)
        active[k] = index
        # the new row's part orthogonal to the earlier ones
        for c in range(6):
            row[c] = columns[c, index]
        _orthogonal(row, basis, k)
        norm = _norm(row)
        if norm < 1e-10:
            return 2
        for c in range(6):
            basis[k, c] = row[c] / norm
        # go on towards larger |v|; the small part of u keeps the direction generic at the start
        for c in range(6):
            d[c] = v[c] + 1e-3 * u[c]
        if k == 5:
            break
        _orthogonal(d, basis, k + 1)
        if _norm(d) < 1e-9:
            for c in range(6):
                d[c] = u[c]
    A = np.empty((6, 6))
    for k in range(6):
        for c in range(6):
            A[k, c] = columns[c, active[k]]
    if abs(np.linalg.det(A)) < 1e-14:
        return 2
    A_inv[:, :] = np.linalg.inv(A)
    return 0


@njit
def _climb(columns, n_wrenches, v, active, A_inv, slack, rates):  # type: ignore[no-untyped-def]
    """Pivot to adjacent vertices of the polar while |v| grows; the largest |v|, or inf.

    An active constraint never stops a way, nor does a wrench that only fills the lanes: both have
    slack without end here.
    """
    n = columns.shape[1]
    best_rates = np.empty(n)
    y = np.empty(6)
    current = 0.0
    for c in range(6):
        current += v[c] * v[c]
    for i in range(n):
        s = 1.0
        for c in range(6):
            s -= columns[c, i] * v[c]
        slack[i] = s if s > 0.0 else 0.0
    for k in range(6):
        slack[active[k]] = np.inf
    for i in range(n_wrenches, n):
        slack[i] = np.inf
    for _ in range(_PIVOTS):
        best_norm = current * (1.0 + _TOLERANCE)
        best_j = -1
        best_i = -1
        best_t = 0.0
        for j in range(6):
            ray = (
                -A_inv[0, j], -A_inv[1, j], -A_inv[2, j], -A_inv[3, j], -A_inv[4, j], -A_inv[5, j]
            )  # fmt: skip
            index, t = nearest_stop(columns, n, ray, slack, rates)
            if t == np.inf:
                return np.inf
            norm = 0.0
            for c in range(6):
                x = v[c] - t * A_inv[c, j]
                norm += x * x
            if norm > best_norm:
                best_norm = norm
                best_j = j
                best_i = index
                best_t = t
                for i in range(n):
                    best_rates[i] = rates[i]
        if best_j < 0:
            break
        for c in range(6):
            v[c] -= best_t * A_inv[c, best_j]
        for i in range(n):
            left = slack[i] - best_t * best_rates[i]
            slack[i] = left if left > 0.0 else 0.0
        slack[active[best_j]] = best_t
        slack[best_i] = np.inf
        active[best_j] = best_i
        # the inverse after row best_j became that of best_i
        for k in range(6):
            y[k] = 0.0
            for c in range(6):
                y[k] += columns[c, best_i] * A_inv[c, k]
        pivot = y[best_j]
        if abs(pivot) < 1e-12:
            break
        for c in range(6):
            column = A_inv[c, best_j] / pivot
            for k in range(6):
                if k != best_j:
                    A_inv[c, k] -= column * y[k]
            A_inv[c, best_j] = column
        current = best_norm
    return current


@njit(allocates=False)
def _epsilon(largest, bound):  # type: ignore[no-untyped-def]
    """Of the largest squared norm that was found, and the smallest support."""
    if largest == 0.0:
        # no start found a vertex (degenerate wrenches): the sampled support is all there is
        return bound
    return min(1.0 / np.sqrt(largest), bound)


@njit
def fast_epsilon(W, directions, n_starts, n_more=0, good=0.0):  # type: ignore[no-untyped-def]
    """Epsilon of conv(W): an upper bound, nearly always exact; -1 without force closure.

    Parameters
    ----------
    W : (n, 6) array
        Wrenches of all pyramid edges.
    directions : (m, 6) array
        Unit directions in which the support function is sampled, from `start_directions`.
    n_starts : int
        How many of them, those of smallest support, start a climb.
    n_more : int
        How many more do where epsilon is above `good` after these.
    good : float
    """
    n = W.shape[0]
    if n < 7:
        return -1.0
    # Columns of the wrenches: a processor takes several wrenches at a time.
    full = -(-n // LANES) * LANES
    columns = np.empty((6, full))
    for i in range(n):
        for c in range(6):
            columns[c, i] = W[i, c]
    filled(columns, n)
    m = directions.shape[0]
    support = np.full((1, m + LANES), np.inf)
    for k in range(m):
        d = directions[k]
        way = (-d[0], -d[1], -d[2], -d[3], -d[4], -d[5])
        h = -lowest_along(columns, full, way)[1]
        if h <= 0.0:
            return -1.0
        support[0, k] = h
    slack, rates = np.empty(full), np.empty(full)
    largest = 0.0
    u = np.empty(6)
    v = np.empty(6)
    active = np.zeros(6, dtype=np.int64)
    A_inv = np.empty((6, 6))
    bound = np.inf
    for start in range(n_starts + n_more):
        if start == n_starts and _epsilon(largest, bound) <= good:
            break
        k, h = lowest_along(support, -(-m // LANES) * LANES, (1.0,))
        bound = min(bound, h)
        support[0, k] = np.inf
        for c in range(6):
            u[c] = directions[k, c]
        status = _run_to_vertex(columns, u, v, active, A_inv, slack, rates)
        if status == 1:
            return -1.0
        if status == 2:
            continue
        norm = _climb(columns, n, v, active, A_inv, slack, rates)
        if norm == np.inf:
            return -1.0
        largest = max(largest, norm)
    return _epsilon(largest, bound)
