"""An evaluator that knows what stands around the part: blocked grasps count as failed attempts.

Where none of the kept grasps is clear, the search runs again on this one. The whole search
then steers away from the support, since a blocked attempt is worth nothing to it, and the archive
takes clear grasps only.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.grasp.evaluator import (
    Attempts,
    AttemptStatus,
    PostureEvaluator,
    Postures,
)
from gpis_grasp_planner.grasp.open_hand import pregrasp_of
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.surroundings.clearance import Cause, clearances
from gpis_grasp_planner.surroundings.clearance_settings import ClearanceSettings
from gpis_grasp_planner.surroundings.hand_motion import HandPieces, hand_motions
from gpis_grasp_planner.surroundings.obstacles import Surroundings

Array = NDArray[np.float64]


class ClearEvaluator:
    """Implements `grasp.evaluator.PostureEvaluator` on top of another one.

    An attempt with force closure whose palm, fingers, closing or approach come too near gets the
    status BLOCKED, epsilon -1 and volume 0. It is checked with the pre-grasp it closed from,
    some 0.2 ms for each with force closure.

    Parameters
    ----------
    evaluator : PostureEvaluator
    hand : HandDescription
    surroundings : Surroundings
        In the object's frame.
    settings : ClearanceSettings
    retreat_m : float [m]
        Length of the approach.

    Attributes
    ----------
    blocked : Counter of Cause
        Attempts with force closure that were blocked so far.
    """

    def __init__(
        self,
        evaluator: PostureEvaluator,
        hand: HandDescription,
        surroundings: Surroundings,
        settings: ClearanceSettings,
        retreat_m: float,
    ):
        self._evaluator = evaluator
        self._hand = hand
        self._surroundings = surroundings
        self._settings = settings
        self._retreat = retreat_m
        self.blocked: Counter[Cause] = Counter()

    @property
    def friction(self) -> Friction:
        """Friction of the pairs of hand link and object."""
        return self._evaluator.friction

    @property
    def n_attempts(self) -> int:
        """Grasp attempts so far."""
        return self._evaluator.n_attempts

    @property
    def n_states(self) -> int:
        """States whose guided potential was asked for so far."""
        return self._evaluator.n_states

    def attempt(self, T_object_palm: Array, spread: Array) -> Attempts:
        """Close the hand at poses (B, 4, 4) with spreads (B,) [rad]."""
        return self._checked(self._evaluator.attempt(T_object_palm, spread))

    def attempt_from(self, T_object_palm: Array, joints: Array) -> Attempts:
        """Close the hand at poses (B, 4, 4) from postures (B, J) [rad]."""
        return self._checked(self._evaluator.attempt_from(T_object_palm, joints))

    def postures(self, T_object_palm: Array, motors: Array) -> Postures:
        """Hands at given motor angles; see the protocol."""
        return self._evaluator.postures(T_object_palm, motors)

    def clear_palm(
        self, T_object_palm: Array, normals_outward: Array, spread: Array, standoff: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Move open hands along the normals until they are free; see the protocol."""
        return self._evaluator.clear_palm(T_object_palm, normals_outward, spread, standoff)

    def approach(
        self, T_object_palm: Array, joints: Array, reach: float
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Move free hands along the palm's axis until they touch; see the protocol."""
        return self._evaluator.approach(T_object_palm, joints, reach)

    def guided_potential(self, T_object_palm: Array, joints: Array) -> Array:
        """Guided potential quality energies (B,), which know nothing of the surroundings."""
        return self._evaluator.guided_potential(T_object_palm, joints)

    def _checked(self, attempts: Attempts) -> Attempts:
        closed = (attempts.status == AttemptStatus.GRASPED) & (attempts.epsilon > 0.0)
        rows = np.flatnonzero(closed)
        if not len(rows) or not self._surroundings:
            return attempts
        T = attempts.T_object_palm[rows]
        motions = hand_motions(
            self._hand,
            T,
            pregrasp_of(attempts, rows, self._hand),
            attempts.joints[rows],
            -self._retreat * T[:, :3, 2],
        )
        found = clearances(HandPieces.of(self._hand), motions, self._surroundings, self._settings)
        bad = rows[[not clearance.clear for clearance in found]]
        self.blocked.update(c.cause for c in found if c.cause is not None)
        attempts.status[bad] = AttemptStatus.BLOCKED
        attempts.epsilon[bad] = -1.0
        attempts.volume[bad] = 0.0
        return attempts
