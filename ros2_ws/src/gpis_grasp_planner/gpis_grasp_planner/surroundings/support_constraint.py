"""The surface that carries the part, as a constraint: the whole hand stays above it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.constraint import ClosedHands, Constraint, Verdict
from gpis_grasp_planner.grasp.hand_motion import HandPieces
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.surroundings.clearance import lowest, phases
from gpis_grasp_planner.surroundings.obstacles import SupportPlane

Array = NDArray[np.float64]

_BEYOND_M = 1e-6  # a shifted hand shall not be blocked by rounding


class SupportConstraint(Constraint):
    """Implements `grasp.constraint.Constraint`.

    The mask takes the hand at its start and at the beginning of its approach, which is exact for
    both; the verdict adds the closing and the closed hand. A plane is cleared by going up: what
    is missing is known after one look.

    Parameters
    ----------
    hand : HandDescription
    plane : SupportPlane
        In the object's frame.
    margin_m : float [m]
        Smallest height over the plane.
    retreat_m : float [m]
        Length of the approach, along the palm's z.
    """

    def __init__(
        self, hand: HandDescription, plane: SupportPlane, margin_m: float, retreat_m: float
    ):
        self._hand = hand
        self._pieces = HandPieces.of(hand)
        self.plane = plane
        self.margin_m = margin_m
        self._retreat = retreat_m
        self._rigid = np.flatnonzero(~self._pieces.moving)

    @property
    def name(self) -> str:
        """The plane's name."""
        return self.plane.name

    @property
    def approach_axis(self) -> Array:
        """Straight down (3,)."""
        return np.asarray(-self.plane.normal)

    def allows(self, T_object_palm: Array, joints: Array) -> NDArray[np.bool_]:
        """Which hands keep the margin on the approach and before they close (B,)."""
        everything = np.arange(len(self._pieces.link))
        return np.asarray(self._heights(T_object_palm, joints, everything) >= self.margin_m)

    def allows_palm(self, T_object_palm: Array, joints: Array) -> NDArray[np.bool_]:
        """The same of the links that the closing does not move (B,)."""
        return np.asarray(self._heights(T_object_palm, joints, self._rigid) >= self.margin_m)

    def nearest(self, T_object_palm: Array, joints: Array) -> Array:
        """The hands lifted along the plane's normal (B, 4, 4) by what they lack."""
        T = np.array(T_object_palm, dtype=float)
        lack = self.margin_m - self._heights(T, joints, np.arange(len(self._pieces.link)))
        T[:, :3, 3] += (np.where(lack > 0.0, lack + _BEYOND_M, 0.0))[:, None] * self.plane.normal
        return T

    def _heights(self, T_object_palm: Array, joints: Array, members: NDArray[np.intp]) -> Array:
        """Lowest height (B,) [m] of some pieces on their approach, its end included."""
        T = T_object_palm[:, None] @ link_transforms(self._hand, joints)
        height = lowest(self._pieces, members, T[:, self._pieces.link[members]], self.plane)
        rise = T_object_palm[:, :3, 2] @ self.plane.normal
        return np.asarray(height - self._retreat * np.maximum(rise, 0.0))

    def verdict(self, closed: ClosedHands) -> Verdict:
        """Which closed hands come too low, in which phase of their way, and by how much."""
        cause = np.full(len(closed), None, dtype=object)
        bottom = np.full(len(closed), np.inf)
        for phase in phases(self._pieces, closed.motions):
            height = np.full(len(closed), np.inf)
            if len(phase.piece):
                height = np.minimum(
                    lowest(self._pieces, phase.piece, phase.T_0, self.plane),
                    lowest(self._pieces, phase.piece, phase.T_1, self.plane),
                )
                height -= phase.bow
            cause[(height < self.margin_m) & (bottom >= self.margin_m)] = phase.cause
            bottom = np.minimum(bottom, height)
        lack = self.margin_m - bottom
        rise = np.where(lack > 0.0, lack + _BEYOND_M, 0.0)
        return Verdict(cause, rise[:, None] * self.plane.normal)
