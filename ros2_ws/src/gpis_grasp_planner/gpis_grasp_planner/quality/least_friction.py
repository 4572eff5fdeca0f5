"""The smallest friction at which a grasp's contacts still have force closure.

All coefficients are lowered by one share; the pyramids of a smaller share lie inside those of a
larger one, so that bisection finds the smallest. Force closure: the wrenches span all six
directions, and the origin is a positive combination of all of them (Murray, Li and Sastry, A
Mathematical Introduction to Robotic Manipulation, 1994, ch. 5).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gpis_grasp_planner.quality.figures import Figure
from gpis_grasp_planner.quality.measure import HeldPart, Measure
from gpis_grasp_planner.quality.min_weight import min_weight_of

FIGURE = Figure(
    "least_friction",
    "",
    False,
    "Smallest friction at which the contacts still have force closure: the largest coefficient "
    "among them, where all are lowered by the same share.",
    "Least mu with 0 inside the wrench hull; Murray, Li and Sastry 1994, ch. 5.",
)
_STEPS = 14  # the share to 1 / 16384
_POSITIVE = 1e-7
_FLAT = 1e-9


def least_friction_of(held: HeldPart) -> float:
    """The smallest coefficient; infinity where there is no force closure at the present one."""
    friction = held.contacts.friction
    if np.linalg.matrix_rank(held.wrenches, tol=_FLAT) < 6 or not _closed(held, 1.0):
        return float("inf")
    low, high = 0.0, 1.0
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        if _closed(held, middle):
            high = middle
        else:
            low = middle
    return float(high * friction.max())


def _closed(held: HeldPart, share: float) -> bool:
    contacts = replace(held.contacts, friction=share * held.contacts.friction)
    return min_weight_of(replace(held, contacts=contacts).wrenches) > _POSITIVE


LEAST_FRICTION = Measure(FIGURE, least_friction_of)
