"""The min-weight margin: how evenly the contacts' edges can share a grasp's equilibrium.

``max l,  sum_i a_i w_i = 0,  sum_i a_i = 1,  a_i >= l``

over the wrenches w_i of all n pyramid edges (Li, Culbertson, Burdick and Ames, FRoGGeR: Fast Robust
Grasp Generation via the Min-Weight Metric, IROS 2023). l is positive where the origin is strictly
inside the hull, and the figure is n l, from 0 to 1: at 1 all edges carry the same. By
``a = l + beta`` it is a linear programme in the standard form, of seven rows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.quality.figures import Figure
from gpis_grasp_planner.quality.linear_programme import OPTIMAL, solve
from gpis_grasp_planner.quality.measure import HeldPart, Measure

FIGURE = Figure(
    "min_weight",
    "",
    True,
    "Smallest share that an edge of a friction pyramid has in the grasp's most even equilibrium, "
    "times their number: 1 where all carry the same, 0 without force closure.",
    "n max l, sum a_i w_i = 0, sum a_i = 1, a_i >= l; Li et al., FRoGGeR, IROS 2023.",
)


def min_weight_of(wrenches: NDArray[np.float64]) -> float:
    """N l of wrenches (n, 6); 0 where the origin is not in their hull."""
    n = len(wrenches)
    A = np.ones((7, n + 1))
    A[:6, :n] = wrenches.T
    A[:6, n] = wrenches.sum(axis=0)
    A[6, n] = n
    b = np.zeros(7)
    b[6] = 1.0
    # the last column is large, and divided by n it is of the order of the others
    A[:, n] /= n
    c = np.zeros(n + 1)
    c[n] = 1.0
    status, value, _ = solve(A, b, c)
    return min(max(value, 0.0), 1.0) if status == OPTIMAL else 0.0


def _of(held: HeldPart) -> float:
    return min_weight_of(held.wrenches)


MIN_WEIGHT = Measure(FIGURE, _of)
