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
from gpis_grasp_planner.geometry.gjk import lowest

Array = NDArray[np.float64]

_PIVOTS = 48
_TOLERANCE = 1e-9


def start_directions(n: int, seed: int = 0) -> Array:
    """Unit directions (n, 6) for :func:`fast_epsilon`; the same for every call of one planner."""
    u = np.random.default_rng(seed).normal(size=(n, 6))
    return np.asarray(u / np.linalg.norm(u, axis=1, keepdims=True))


@njit(allocates=False)
def _heights(columns, n, d, heights):  # type: ignore[no-untyped-def]
    """Products of the wrenches, columns of (6, n), with d (6,), into heights (n,).

    In the order of a sum that begins with 0: to the bit what a loop over the six gives.
    """
    x, y, z, u, v, w = d[0], d[1], d[2], d[3], d[4], d[5]
    for i in range(n):
        heights[i] = (
            0.0 + columns[0, i] * x + columns[1, i] * y + columns[2, i] * z
            + columns[3, i] * u + columns[4, i] * v + columns[5, i] * w
        )  # fmt: skip


@njit(allocates=False)
def _steps(slack, rates, n, steps):  # type: ignore[no-untyped-def]
    """How far each constraint lets go at its rate, into steps (n,)."""
    for i in range(n):
        steps[i] = slack[i] / rates[i] if rates[i] > 1e-11 else np.inf


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
def _run_to_vertex(columns, u, v, active, A_inv, slack, rates, steps):  # type: ignore[no-untyped-def]
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
        _heights(columns, n, d, rates)
        _steps(slack, rates, n, steps)
        index, best = lowest(steps, n)
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
def _climb(columns, v, active, A_inv, slack, rates, steps):  # type: ignore[no-untyped-def]
    """Pivot to adjacent vertices of the polar while |v| grows; the largest |v|, or inf."""
    n = columns.shape[1]
    best_rates = np.empty(n)
    ray = np.empty(6)
    y = np.empty(6)
    current = 0.0
    for c in range(6):
        current += v[c] * v[c]
    for i in range(n):
        s = 1.0
        for c in range(6):
            s -= columns[c, i] * v[c]
        slack[i] = max(s, 0.0)
    for _ in range(_PIVOTS):
        best_norm = current * (1.0 + _TOLERANCE)
        best_j = -1
        best_i = -1
        best_t = 0.0
        for j in range(6):
            for c in range(6):
                ray[c] = -A_inv[c, j]
            _heights(columns, n, ray, rates)
            _steps(slack, rates, n, steps)
            for k in range(6):
                steps[active[k]] = np.inf
            index, t = lowest(steps, n)
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
        old = active[best_j]
        for k in range(6):
            best_rates[active[k]] = 0.0  # their slack stays
        for i in range(n):
            slack[i] = max(slack[i] - best_t * best_rates[i], 0.0)
        slack[old] = best_t
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


@njit
def fast_epsilon(W, directions, n_starts):  # type: ignore[no-untyped-def]
    """Epsilon of conv(W): an upper bound, nearly always exact; -1 without force closure.

    Parameters
    ----------
    W : (n, 6) array
        Wrenches of all pyramid edges.
    directions : (m, 6) array
        Unit directions in which the support function is sampled, from `start_directions`.
    n_starts : int
        How many of them, those of smallest support, start a climb.
    """
    n = W.shape[0]
    if n < 7:
        return -1.0
    # Columns of the wrenches: a processor takes several wrenches at a time.
    columns = np.empty((6, n))
    for i in range(n):
        for c in range(6):
            columns[c, i] = W[i, c]
    slack, rates, steps = np.empty(n), np.empty(n), np.empty(n)
    m = directions.shape[0]
    support = np.empty(m)
    u = np.empty(6)
    for k in range(m):
        for c in range(6):
            u[c] = -directions[k, c]
        _heights(columns, n, u, rates)
        h = -lowest(rates, n)[1]
        if h <= 0.0:
            return -1.0
        support[k] = h
    largest = 0.0
    v = np.empty(6)
    active = np.zeros(6, dtype=np.int64)
    A_inv = np.empty((6, 6))
    bound = np.inf
    for _ in range(n_starts):
        k, h = lowest(support, m)
        bound = min(bound, h)
        support[k] = np.inf
        for c in range(6):
            u[c] = directions[k, c]
        status = _run_to_vertex(columns, u, v, active, A_inv, slack, rates, steps)
        if status == 1:
            return -1.0
        if status == 2:
            continue
        norm = _climb(columns, v, active, A_inv, slack, rates, steps)
        if norm == np.inf:
            return -1.0
        largest = max(largest, norm)
    if largest == 0.0:
        # no start found a vertex (degenerate wrenches): the sampled support is all there is
        return bound
    return min(1.0 / np.sqrt(largest), bound)
