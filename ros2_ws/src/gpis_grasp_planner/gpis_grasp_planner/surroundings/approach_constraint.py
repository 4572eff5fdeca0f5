"""The allowed approach, as a constraint on the palm's direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.constraint import ClosedHands, Constraint, Verdict
from gpis_grasp_planner.surroundings.clearance import Cause

Array = NDArray[np.float64]

_ROUNDING = 1e-9


class ApproachConstraint(Constraint):
    """Implements `grasp.constraint.Constraint`: exact before the closing, nothing left after it.

    Parameters
    ----------
    axis : (3,) array
        Unit vector in the object's frame.
    half_angle_deg : float [deg]
    T_palm_pivot : (4, 4) array
        The palm is turned into the cone about this point of it (its face), so that what lay
        before it stays there.
    """

    def __init__(self, axis: Array, half_angle_deg: float, T_palm_pivot: Array):
        self._axis = np.asarray(axis, dtype=float)
        self._half_angle = np.deg2rad(half_angle_deg)
        self._pivot = np.asarray(T_palm_pivot, dtype=float)[:3, 3]

    @property
    def name(self) -> str:
        """The same as the cause."""
        return str(Cause.DIRECTION)

    @property
    def approach_axis(self) -> Array:
        """The cone's axis (3,)."""
        return self._axis

    def allows(self, T_object_palm: Array, _joints: Array, /) -> NDArray[np.bool_]:
        """Which palms point into the cone (B,)."""
        return np.asarray(self._angles(T_object_palm) <= self._half_angle + _ROUNDING)

    def allows_palm(self, T_object_palm: Array, _joints: Array, /) -> NDArray[np.bool_]:
        """The same: it is the palm that points."""
        return self.allows(T_object_palm, _joints)

    def nearest(self, T_object_palm: Array, _joints: Array, /) -> Array:
        """The palms (B, 4, 4) turned about their face by the smallest angle into the cone."""
        T = np.array(T_object_palm, dtype=float)
        angle = self._angles(T)
        rows = np.flatnonzero(angle > self._half_angle + _ROUNDING)
        if not len(rows):
            return T
        z = T[rows, :3, 2]
        turn_axis = np.cross(z, self._axis)
        length = np.linalg.norm(turn_axis, axis=1, keepdims=True)
        # straight against the axis any direction is as good; the palm's x is at hand
        turn_axis = np.where(length < 1e-9, T[rows, :3, 0], turn_axis / np.maximum(length, 1e-12))
        R = _turns(turn_axis, angle[rows] - self._half_angle)
        pivot = T[rows, :3, :3] @ self._pivot + T[rows, :3, 3]
        T[rows, :3, :3] = R @ T[rows, :3, :3]
        T[rows, :3, 3] = pivot - T[rows, :3, :3] @ self._pivot
        return T

    def verdict(self, closed: ClosedHands) -> Verdict:
        """Which closed hands came from elsewhere."""
        verdict = Verdict.clear(len(closed))
        verdict.cause[~self.allows(closed.T_object_palm, closed.joints)] = Cause.DIRECTION
        return verdict

    def _angles(self, T_object_palm: Array) -> Array:
        z = np.asarray(T_object_palm)[:, :3, 2]
        sine = np.linalg.norm(np.cross(z, self._axis), axis=1)
        return np.arctan2(sine, z @ self._axis)


def _turns(axis: Array, angle: Array) -> Array:
    """Rotations (n, 3, 3) about unit axes (n, 3) by angles (n,) [rad] (Rodrigues)."""
    K = np.zeros((len(axis), 3, 3))
    K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -axis[:, 2], axis[:, 1], -axis[:, 0]
    K -= K.transpose(0, 2, 1)
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.asarray(np.eye(3) + s * K + (1.0 - c) * (K @ K))
