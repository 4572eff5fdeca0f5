"""The open hand that an attempt closed from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.evaluator import Attempts
from gpis_grasp_planner.hand.description import HandDescription

Array = NDArray[np.float64]


def open_postures(hand: HandDescription, preshape: Array) -> Array:
    """Postures (B, J) [rad] of the open hand at pre-shapes (B, S) [rad or m]."""
    joints = np.zeros((len(preshape), hand.n_joints))
    hand.preshape.put(joints, preshape)
    return joints


def pregrasp_of(attempts: Attempts, rows: NDArray[np.intp], hand: HandDescription) -> Array:
    """Postures (n, J) [rad] from which the given attempts closed."""
    if attempts.start_joints is not None:
        return np.array(attempts.start_joints[rows])
    return open_postures(hand, attempts.preshape[rows])
