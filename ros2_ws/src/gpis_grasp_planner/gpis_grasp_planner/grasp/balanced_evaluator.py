"""An evaluator that tells of each grasp whether the closing hand's own forces balance on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.grasp.evaluator import (
    Attempts,
    AttemptStatus,
    PostureEvaluator,
    Postures,
)
from gpis_grasp_planner.quality.closing_balance import ClosingBalance

Array = NDArray[np.float64]


class BalancedEvaluator:
    """Implements `grasp.evaluator.PostureEvaluator` on top of another one.

    Attempts with force closure get their `imbalance`, by which their objective is less
    (:func:`~gpis_grasp_planner.quality.balance_factor.balance_factor`).

    Parameters
    ----------
    evaluator : PostureEvaluator
    balance : ClosingBalance
        Of the same hand and part.

    Notes
    -----
    Some 0.05 to 0.1 ms for each attempt with force closure.
    """

    def __init__(self, evaluator: PostureEvaluator, balance: ClosingBalance):
        self._evaluator, self._balance = evaluator, balance

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
        return self._judged(self._evaluator.attempt(T_object_palm, spread))

    def attempt_from(self, T_object_palm: Array, joints: Array) -> Attempts:
        """Close the hand at poses (B, 4, 4) from postures (B, J) [rad]."""
        return self._judged(self._evaluator.attempt_from(T_object_palm, joints))

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
        """Guided potential quality energies (B,) of states; see the protocol."""
        return self._evaluator.guided_potential(T_object_palm, joints)

    def _judged(self, attempts: Attempts) -> Attempts:
        closed = (attempts.status == AttemptStatus.GRASPED) & (attempts.epsilon > 0.0)
        imbalance = np.zeros(len(attempts))
        imbalance[closed] = self._balance.imbalance(
            attempts.T_object_palm[closed],
            attempts.joints[closed],
            attempts.n_contacts[closed],
            attempts.positions[closed],
            attempts.normals_inward[closed],
            attempts.friction[closed],
            attempts.links[closed],
        )
        return replace(attempts, imbalance=imbalance)
