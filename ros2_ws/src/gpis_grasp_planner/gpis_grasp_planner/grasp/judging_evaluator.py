"""The base of evaluators that judge what another one closed."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.grasp.evaluator import Attempts, PostureEvaluator, Postures

Array = NDArray[np.float64]


class JudgingEvaluator(ABC):
    """Implements `grasp.evaluator.PostureEvaluator`: another one's attempts, judged.

    Parameters
    ----------
    evaluator : PostureEvaluator
    """

    def __init__(self, evaluator: PostureEvaluator):
        self._evaluator = evaluator

    @abstractmethod
    def judged(self, attempts: Attempts) -> Attempts:
        """The attempts with what is to be said of them."""

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

    def attempt(self, T_object_palm: Array, preshape: Array) -> Attempts:
        """Close the hand at poses (B, 4, 4) with pre-shapes (B, S)."""
        return self.judged(self._evaluator.attempt(T_object_palm, preshape))

    def attempt_from(self, T_object_palm: Array, joints: Array) -> Attempts:
        """Close the hand at poses (B, 4, 4) from postures (B, J) [rad]."""
        return self.judged(self._evaluator.attempt_from(T_object_palm, joints))

    def postures(self, T_object_palm: Array, motors: Array) -> Postures:
        """Hands at given motor angles; see the protocol."""
        return self._evaluator.postures(T_object_palm, motors)

    def clear_palm(
        self, T_object_palm: Array, normals_outward: Array, preshape: Array, standoff: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Move open hands along the normals until they are free; see the protocol."""
        return self._evaluator.clear_palm(T_object_palm, normals_outward, preshape, standoff)

    def approach(
        self, T_object_palm: Array, joints: Array, reach: float
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Move free hands along the palm's axis until they touch; see the protocol."""
        return self._evaluator.approach(T_object_palm, joints, reach)

    def guided_potential(self, T_object_palm: Array, joints: Array) -> Array:
        """Guided potential quality energies (B,) of states; see the protocol."""
        return self._evaluator.guided_potential(T_object_palm, joints)
