"""Boxes and meshes around the part, as a constraint: the hand keeps a margin from all of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.constraint import ClosedHands, Constraint, Verdict
from gpis_grasp_planner.grasp.hand_motion import HandPieces
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.surroundings.clearance import approach_phase, clearances, phase_distance
from gpis_grasp_planner.surroundings.clearance_settings import ClearanceSettings
from gpis_grasp_planner.surroundings.obstacles import Obstacle, Surroundings

Array = NDArray[np.float64]


class ObstacleConstraint(Constraint):
    """Implements `grasp.constraint.Constraint` for solid bodies.

    The mask is the exact distance on the approach, its end included; the verdict is that of
    `surroundings.clearance`. How to get round a body is not known here.

    Parameters
    ----------
    hand : HandDescription
    obstacles : sequence of BoxObstacle and MeshObstacle
        In the object's frame.
    settings : ClearanceSettings
    retreat_m : float [m]
        Length of the approach, along the palm's z.
    name : str
    """

    def __init__(
        self,
        hand: HandDescription,
        obstacles: tuple[Obstacle, ...],
        settings: ClearanceSettings,
        retreat_m: float,
        name: str = "obstacles",
    ):
        self._hand = hand
        self._pieces = HandPieces.of(hand)
        self._around = Surroundings(None, tuple(obstacles))
        self._settings = settings
        self._retreat = retreat_m
        self._name = name

    @property
    def name(self) -> str:
        """What the bodies are called together."""
        return self._name

    def allows(self, T_object_palm: Array, joints: Array) -> NDArray[np.bool_]:
        """Which hands keep the margin on the approach and before they close (B,)."""
        return self._keeps(T_object_palm, joints, np.arange(len(self._pieces.link)))

    def allows_palm(self, T_object_palm: Array, joints: Array) -> NDArray[np.bool_]:
        """The same of the links that the closing does not move (B,)."""
        return self._keeps(T_object_palm, joints, np.flatnonzero(~self._pieces.moving))

    def _keeps(
        self, T_object_palm: Array, joints: Array, members: NDArray[np.intp]
    ) -> NDArray[np.bool_]:
        free = np.ones(len(T_object_palm), dtype=np.bool_)
        if not len(free):
            return free
        T = T_object_palm[:, None] @ link_transforms(self._hand, joints)
        back = -self._retreat * T_object_palm[:, :3, 2]
        way = approach_phase(self._pieces, T, back, members)
        margin = self._settings.margin_m
        for body in self._around.obstacles:
            rows = np.flatnonzero(free)
            free[rows] = phase_distance(self._pieces, way, rows, body, margin) >= margin
        return free

    def verdict(self, closed: ClosedHands) -> Verdict:
        """Which closed hands come too near to a body, and in which phase of their way."""
        verdict = Verdict.clear(len(closed))
        found = clearances(self._pieces, closed.motions, self._around, self._settings)
        verdict.cause[:] = [clearance.cause for clearance in found]
        return verdict
