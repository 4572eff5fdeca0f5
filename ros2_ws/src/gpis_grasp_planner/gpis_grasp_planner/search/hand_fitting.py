"""Closes the hands that a search proposes, moved to where the constraints let them.

A proposal that lacks a few millimetres of height over the table is as good as lost, and most of a
part's best grasps on a table are just such: fingertips as low as they may. So what a constraint
knows about the way out is used: before the closing the nearest place for the palm
(`Constraint.nearest`), after it the translation that would have freed the closed hand
(`Attempts.shift`). Without constraints the evaluator is asked as it is.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.evaluator import Attempts, AttemptStatus
from gpis_grasp_planner.hand.drive import joints_from_motors

if TYPE_CHECKING:
    from gpis_grasp_planner.search.context import PlanningContext

Array = NDArray[np.float64]

_FARTHEST_M = 0.12
_ROUNDS = 2
_NARROW = 1.7  # motors [rad] of a hand that is closed about something small


class HandFitting:
    """Attempts for a search; a row's pose may differ from what was asked.

    Parameters
    ----------
    context : PlanningContext
    """

    def __init__(self, context: PlanningContext):
        self._evaluator = context.evaluator
        self._hand = context.hand
        self._constraints = context.constraints

    @property
    def approach_axis(self) -> Array | None:
        """The first of the constraints' axes (3,); None without any."""
        axes = [c.approach_axis for c in self._constraints if c.approach_axis is not None]
        return axes[0] if axes else None

    def attempt(
        self, T_object_palm: Array, preshape: Array, joints: Array | None = None
    ) -> Attempts:
        """Close hands near poses (B, 4, 4) with pre-shapes (B, S); `T_object_palm` says where.

        `joints` (B, J) [rad] are the postures in which they are expected to hold; without, hands
        that are closed about something small.
        """
        if not self._constraints:
            return self._evaluator.attempt(T_object_palm, preshape)
        if joints is None:
            motors = np.tile(_NARROW * self._hand.closing_unit, (len(preshape), 1))
            joints = joints_from_motors(self._hand, preshape, motors)
        T = self._nearest(T_object_palm, joints)
        attempts = self._evaluator.attempt(T, preshape)
        for _ in range(_ROUNDS):
            T = self._freed(attempts)
            rows = np.flatnonzero((attempts.T_object_palm != T).any(axis=(1, 2)))
            if not len(rows):
                break
            again = self._evaluator.attempt(T[rows], attempts.preshape[rows])
            attempts = _merged(attempts, rows, again)
        return attempts

    def way_to_allowed(self, T_object_palm: Array, joints: Array) -> Array:
        """How far hands (B, 4, 4), (B, J) [rad] are from where constraints let them (B,) [m]."""
        T = self._allowed(T_object_palm, joints)
        return np.asarray(np.linalg.norm((T - T_object_palm)[:, :3, 3], axis=1))

    def _freed(self, attempts: Attempts) -> Array:
        """Where worthless attempts would have been allowed (B, 4, 4); the others stay."""
        assert attempts.shift is not None
        T = attempts.T_object_palm.copy()
        blocked = attempts.shift.any(axis=1)
        T[blocked, :3, 3] += attempts.shift[blocked]
        loose = (attempts.status == AttemptStatus.GRASPED) & (attempts.epsilon <= 0.0)
        T[loose] = self._nearest(T[loose], attempts.joints[loose])
        way = np.linalg.norm((T - attempts.T_object_palm)[:, :3, 3], axis=1)
        return np.where((way < _FARTHEST_M)[:, None, None], T, attempts.T_object_palm)

    def _allowed(self, T_object_palm: Array, joints: Array) -> Array:
        """The hands where the constraints let them, each asked after the other (B, 4, 4)."""
        T = T_object_palm
        for constraint in self._constraints:
            T = constraint.nearest(T, joints)
        return T

    def _nearest(self, T_object_palm: Array, joints: Array) -> Array:
        """The hands where the constraints let them, if that is near; else where they are."""
        T = self._allowed(T_object_palm, joints)
        near = np.linalg.norm((T - T_object_palm)[:, :3, 3], axis=1) < _FARTHEST_M
        return np.where(near[:, None, None], T, T_object_palm)


def _merged(attempts: Attempts, rows: NDArray[np.intp], new: Attempts) -> Attempts:
    values = {}
    for field in fields(attempts):
        value = getattr(attempts, field.name)
        if value is not None:
            value = np.array(value)
            value[rows] = getattr(new, field.name)
        values[field.name] = value
    return replace(attempts, **values)
