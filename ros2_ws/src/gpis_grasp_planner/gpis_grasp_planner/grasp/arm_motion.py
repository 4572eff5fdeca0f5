"""How an arm carries the hand to a grasp and lifts it, in the arm's joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ArmMotion:
    """The straight way of the flange, sampled; between samples the joints move in proportion.

    Attributes
    ----------
    arm : str
        Name of the arm, or its file.
    joint_names : tuple of str, n entries
    approach : (K, n) array [rad]
        From the pre-grasp's place to the grasp; the hand keeps its pre-grasp posture.
    lift : (M, n) array [rad]
        From the grasp upwards; the first row is the last of `approach`.
    manipulability : float
        Yoshikawa's ``sqrt(det(J J^T))`` at the grasp (1985, eq. 9) over the largest value that the
        arm was seen to have: 0 in a singular posture, 1 in its best.
    worth : float
        What that adds to the grasp's objective: the setting's weight times `manipulability`.
    """

    arm: str
    joint_names: tuple[str, ...]
    approach: Array
    lift: Array
    manipulability: float
    worth: float = 0.0

    @property
    def pregrasp(self) -> Array:
        """Joints (n,) [rad] where the approach begins."""
        return np.asarray(self.approach[0])

    @property
    def grasp(self) -> Array:
        """Joints (n,) [rad] where the hand closes."""
        return np.asarray(self.approach[-1])

    @property
    def lifted(self) -> Array:
        """Joints (n,) [rad] at the end of the lift."""
        return np.asarray(self.lift[-1])
