"""Small linear programmes over the wrenches of a grasp (compiled, some 0.05 ms).

``max c^T x,  A x = b,  x >= 0`` with few rows (seven: a wrench and a sum) and some hundred columns,
by the two phases of the simplex method on a dense tableau (Dantzig, Linear Programming and
Extensions, 1963, ch. 5). The steepest column enters; grasps are symmetrical and thus degenerate, so
that after a number of steps Bland's rule takes over, which cannot cycle (Bland, Math. Oper. Res.
2, 1977).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.compiled import njit

Array = NDArray[np.float64]

OPTIMAL, INFEASIBLE, UNBOUNDED, GAVE_UP = 0, 1, 2, 3
_TOLERANCE = 1e-10
_FEASIBLE = 1e-8
_STEEPEST = 200
_STEPS = 5000


@njit
def maximise(A, b, c):  # type: ignore[no-untyped-def]
    """``max c x`` over ``A x = b, x >= 0``: status, value and x (n,).

    `A` (m, n) and `b` (m,) should be of the order of 1. Value and x are 0 unless OPTIMAL.
    """
    m, n = A.shape
    table = np.zeros((m + 1, n + m + 1))
    basis = np.zeros(m, dtype=np.int64)
    for i in range(m):
        sign = -1.0 if b[i] < 0.0 else 1.0
        for j in range(n):
            table[i, j] = sign * A[i, j]
        table[i, n + i] = 1.0
        table[i, n + m] = sign * b[i]
        basis[i] = n + i
    x = np.zeros(n)
    # first phase: the sum of the artificial variables, negated, is driven to 0
    for j in range(n + m + 1):
        if j < n or j == n + m:
            for i in range(m):
                table[m, j] += table[i, j]
    status = _iterate(table, basis, n)
    if status != OPTIMAL:
        return GAVE_UP, 0.0, x
    if table[m, n + m] > _FEASIBLE:
        return INFEASIBLE, 0.0, x
    for i in range(m):  # what is left of them, at 0, leaves for any column that can stand in
        if basis[i] >= n:
            best, at = _TOLERANCE, -1
            for j in range(n):
                if abs(table[i, j]) > best:
                    best, at = abs(table[i, j]), j
            if at >= 0:
                _pivot(table, basis, i, at)
    for j in range(n + m + 1):
        table[m, j] = c[j] if j < n else 0.0
    for i in range(m):
        if basis[i] < n:
            price = c[basis[i]]
            for j in range(n + m + 1):
                table[m, j] -= price * table[i, j]
    status = _iterate(table, basis, n)
    if status != OPTIMAL:
        return status, 0.0, x
    value = 0.0
    for i in range(m):
        if basis[i] < n:
            x[basis[i]] = table[i, n + m]
            value += c[basis[i]] * table[i, n + m]
    return OPTIMAL, value, x


@njit
def _iterate(table, basis, n):  # type: ignore[no-untyped-def]
    """Pivot until no column of the first n improves the last row."""
    m = len(basis)
    last = table.shape[1] - 1
    for step in range(_STEPS):
        entering, steepest = -1, _TOLERANCE
        for j in range(n):
            if table[m, j] > steepest:
                entering, steepest = j, table[m, j]
                if step >= _STEEPEST:
                    break
        if entering < 0:
            return OPTIMAL
        leaving, least = -1, 0.0
        for i in range(m):
            if table[i, entering] > _TOLERANCE:
                ratio = table[i, last] / table[i, entering]
                better = leaving < 0 or ratio < least - 1e-13
                tied = leaving >= 0 and abs(ratio - least) <= 1e-13
                if tied and step < _STEEPEST:  # of equals the largest pivot: the safest
                    better = table[i, entering] > table[leaving, entering]
                elif tied:
                    better = basis[i] < basis[leaving]
                if better:
                    leaving, least = i, ratio
        if leaving < 0:
            return UNBOUNDED
        _pivot(table, basis, leaving, entering)
    return GAVE_UP


@njit
def _pivot(table, basis, row, column):  # type: ignore[no-untyped-def]
    width = table.shape[1]
    pivot = table[row, column]
    for j in range(width):
        table[row, j] /= pivot
    for i in range(table.shape[0]):
        factor = table[i, column]
        if i != row and factor != 0.0:
            for j in range(width):
                table[i, j] -= factor * table[row, j]
    basis[row] = column


def solve(A: Array, b: Array, c: Array) -> tuple[int, float, Array]:
    """:func:`maximise` for arrays of any layout."""
    status, value, x = maximise(
        np.array(A, dtype=float, order="C"), np.array(b, dtype=float), np.array(c, dtype=float)
    )
    return int(status), float(value), np.asarray(x)
