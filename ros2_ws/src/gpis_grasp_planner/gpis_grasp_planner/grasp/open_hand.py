"""The open hand that an attempt closed from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.evaluator import Attempts
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.preshape import set_spread

Array = NDArray[np.float64]


def open_postures(hand: HandDescription, spread: Array) -> Array:
    """Postures (B, J) [rad] of the open hand at spreads (B,) [rad]."""
    joints = np.zeros((len(spread), hand.n_joints))
    set_spread(hand, joints, spread)
    return joints


def pregrasp_of(attempts: Attempts, rows: NDArray[np.intp], hand: HandDescription) -> Array:
    """Postures (n, J) [rad] from which the given attempts closed."""
    if attempts.start_joints is not None:
        return np.array(attempts.start_joints[rows])
    return open_postures(hand, attempts.spread[rows])
