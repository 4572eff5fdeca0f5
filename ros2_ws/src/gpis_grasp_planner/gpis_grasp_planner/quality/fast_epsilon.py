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

Array = NDArray[np.float64]

_PIVOTS = 48
_TOLERANCE = 1e-9


def start_directions(n: int, seed: int = 0) -> Array:
    """Unit directions (n, 6) for :func:`fast_epsilon`; the same for every call of one planner."""
    u = np.random.default_rng(seed).normal(size=(n, 6))
    return np.asarray(u / np.linalg.norm(u, axis=1, keepdims=True))


@njit
def _run_to_vertex(W, u, v, active, A_inv):  # type: ignore[no-untyped-def]
    """From v = 0 along u into a vertex of the polar; False where it is unbounded.

    On success `v` is the vertex, `active` its six constraints and `A_inv` the inverse of their
    rows. Directions are kept orthogonal to the active rows by Gram-Schmidt.
    """
    n = W.shape[0]
    basis = np.zeros((6, 6))
    slack = np.ones(n)
    for k in range(6):
        v[k] = 0.0
    d = u.copy()
    for k in range(6):
        for _ in range(2):
            for j in range(k):
                dot = 0.0
                for c in range(6):
                    dot += basis[j, c] * d[c]
                for c in range(6):
                    d[c] -= dot * basis[j, c]
        norm = np.sqrt(np.sum(d * d))
        if norm < 1e-10:
            return 2
        d /= norm
        best = np.inf
        index = -1
        for i in range(n):
            rate = 0.0
            for c in range(6):
                rate += W[i, c] * d[c]
            if rate > 1e-11:
                t = slack[i] / rate
                if t < best:
                    best = t
                    index = i
        if index < 0:
            return 1
        for c in range(6):
            v[c] += best * d[c]
        for i in range(n):
            rate = 0.0
            for c in range(6):
                rate += W[i, c] * d[c]
            slack[i] = max(slack[i] - best * rate, 0.0)
        active[k] = index
        # the new row's part orthogonal to the earlier ones
        b = W[index].copy()
        for _ in range(2):
            for j in range(k):
                dot = 0.0
                for c in range(6):
                    dot += basis[j, c] * b[c]
                for c in range(6):
                    b[c] -= dot * basis[j, c]
        norm = np.sqrt(np.sum(b * b))
        if norm < 1e-10:
            return 2
        basis[k] = b / norm
        # go on towards larger |v|; the small part of u keeps the direction generic at the start
        for c in range(6):
            d[c] = v[c] + 1e-3 * u[c]
        if k == 5:
            break
        for _ in range(2):
            for j in range(k + 1):
                dot = 0.0
                for c in range(6):
                    dot += basis[j, c] * d[c]
                for c in range(6):
                    d[c] -= dot * basis[j, c]
        norm = np.sqrt(np.sum(d * d))
        if norm < 1e-9:
            for c in range(6):
                d[c] = u[c]
    A = np.empty((6, 6))
    for k in range(6):
        A[k] = W[active[k]]
    if abs(np.linalg.det(A)) < 1e-14:
        return 2
    A_inv[:, :] = np.linalg.inv(A)
    return 0


@njit
def _climb(W, v, active, A_inv):  # type: ignore[no-untyped-def]
    """Pivot to adjacent vertices of the polar while |v| grows; the largest |v|, or inf."""
    n = W.shape[0]
    slack = np.empty(n)
    rates = np.empty(n)
    best_rates = np.empty(n)
    current = np.sum(v * v)
    is_active = np.zeros(n, dtype=np.bool_)
    for k in range(6):
        is_active[active[k]] = True
    for i in range(n):
        s = 1.0
        for c in range(6):
            s -= W[i, c] * v[c]
        slack[i] = max(s, 0.0)
    for _ in range(_PIVOTS):
        best_norm = current * (1.0 + _TOLERANCE)
        best_j = -1
        best_i = -1
        best_t = 0.0
        for j in range(6):
            t = np.inf
            index = -1
            for i in range(n):
                if is_active[i]:
                    continue
                rate = 0.0
                for c in range(6):
                    rate -= W[i, c] * A_inv[c, j]
                rates[i] = rate
                if rate > 1e-11:
                    step = slack[i] / rate
                    if step < t:
                        t = step
                        index = i
            if index < 0:
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
                best_rates[:] = rates
        if best_j < 0:
            break
        for c in range(6):
            v[c] -= best_t * A_inv[c, best_j]
        is_active[active[best_j]] = False
        old = active[best_j]
        for i in range(n):
            if not is_active[i]:
                slack[i] = max(slack[i] - best_t * best_rates[i], 0.0)
        slack[old] = best_t
        active[best_j] = best_i
        is_active[best_i] = True
        # the inverse after row best_j became W[best_i]
        y = np.zeros(6)
        for k in range(6):
            for c in range(6):
                y[k] += W[best_i, c] * A_inv[c, k]
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
    m = directions.shape[0]
    support = np.empty(m)
    for k in range(m):
        h = -np.inf
        for i in range(n):
            s = 0.0
            for c in range(6):
                s += W[i, c] * directions[k, c]
            if s > h:
                h = s
        if h <= 0.0:
            return -1.0
        support[k] = h
    largest = 0.0
    v = np.empty(6)
    active = np.zeros(6, dtype=np.int64)
    A_inv = np.empty((6, 6))
    bound = np.inf
    for _ in range(n_starts):
        k = int(np.argmin(support))
        bound = min(bound, support[k])
        support[k] = np.inf
        status = _run_to_vertex(W, directions[k], v, active, A_inv)
        if status == 1:
            return -1.0
        if status == 2:
            continue
        norm = _climb(W, v, active, A_inv)
        if norm == np.inf:
            return -1.0
        largest = max(largest, norm)
    if largest == 0.0:
        # no start found a vertex (degenerate wrenches): the sampled support is all there is
        return bound
    return min(1.0 / np.sqrt(largest), bound)
