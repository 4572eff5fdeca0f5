"""The open hand that an attempt closed from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.evaluator import Attempts
from gpis_grasp_planner.hand.description import HandDescription

Array = NDArray[np.float64]


def pregrasp_of(attempts: Attempts, rows: NDArray[np.intp], hand: HandDescription) -> Array:
    """Postures (n, J) [rad] from which the given attempts closed."""
    if attempts.start_joints is not None:
        return np.array(attempts.start_joints[rows])
    pregrasp = np.zeros((len(rows), hand.n_joints))
    for finger in hand.fingers:
        if finger.spread_joint >= 0:
            pregrasp[:, finger.spread_joint] = attempts.spread[rows]
    return pregrasp
