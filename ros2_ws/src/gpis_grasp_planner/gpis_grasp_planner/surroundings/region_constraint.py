"""A forbidden region of the part, as a constraint on contacts and links."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.constraint import ClosedHands, Constraint, Verdict
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.surroundings.clearance import Cause
from gpis_grasp_planner.surroundings.clearance_settings import ClearanceSettings
from gpis_grasp_planner.surroundings.forbidden_region import ForbiddenRegion
from gpis_grasp_planner.surroundings.obstacle_constraint import ObstacleConstraint

Array = NDArray[np.float64]


class RegionConstraint(Constraint):
    """Implements `grasp.constraint.Constraint`: the box is a body, and no contact lies in it.

    Parameters
    ----------
    hand : HandDescription
    region : ForbiddenRegion
    settings : ClearanceSettings
        Its margin gives way to the region's.
    retreat_m : float [m]
    """

    def __init__(
        self,
        hand: HandDescription,
        region: ForbiddenRegion,
        settings: ClearanceSettings,
        retreat_m: float,
    ):
        self.region = region
        settings = replace(settings, margin_m=max(region.margin_m, 1e-4))
        self._body = ObstacleConstraint(hand, (region.box,), settings, retreat_m, region.name)

    @property
    def name(self) -> str:
        """The region's name."""
        return self.region.name

    def allows(self, T_object_palm: Array, joints: Array) -> NDArray[np.bool_]:
        """Which hands keep from the region on the approach and before they close (B,)."""
        return self._body.allows(T_object_palm, joints)

    def allows_palm(self, T_object_palm: Array, joints: Array) -> NDArray[np.bool_]:
        """The same of the links that the closing does not move (B,)."""
        return self._body.allows_palm(T_object_palm, joints)

    def verdict(self, closed: ClosedHands) -> Verdict:
        """Which closed hands touch the region or come too near on their way."""
        verdict = self._body.verdict(closed)
        bad = verdict.blocked
        real = np.arange(closed.positions.shape[1]) < closed.n_contacts[:, None]
        bad |= (self.region.contains(closed.positions) & real).any(axis=1)
        verdict.cause[bad] = Cause.REGION
        return verdict
