"""The spread, what a hand sets before it closes: one figure that moves the spread joints.

Each joint follows it with its own gain (`Finger.spread_gain`), 1 where the description has none.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.hand.description import HandDescription

Array = NDArray[np.float64]


def set_spread(hand: HandDescription, joints: Array, spread: ArrayLike) -> None:
    """Put spreads (B,) [rad] into joints (B, J) [rad], in place."""
    for finger in hand.fingers:
        if finger.spread_joint >= 0:
            joints[:, finger.spread_joint] = finger.spread_gain * np.asarray(spread)


def spread_of(hand: HandDescription, joints: Array) -> Array:
    """Spreads (B,) [rad] of joints (B, J) [rad]: the mean over what each joint says."""
    said = _spreads(hand, joints)
    return said.mean(axis=1) if said.shape[1] else np.zeros(len(joints))


def spreads_agree(hand: HandDescription, joints: Array, tolerance: float) -> NDArray[np.bool_]:
    """Whether the spread joints of (B, J) [rad] follow one spread, (B,)."""
    apart = np.zeros((len(joints), hand.n_joints))
    set_spread(hand, apart, spread_of(hand, joints))
    spreading = [finger.spread_joint for finger in hand.fingers if finger.spread_joint >= 0]
    off = np.abs(joints[:, spreading] - apart[:, spreading])
    return np.asarray(2.0 * off.max(axis=1, initial=0.0) <= tolerance)


def _spreads(hand: HandDescription, joints: Array) -> Array:
    moving = [f for f in hand.fingers if f.spread_joint >= 0 and f.spread_gain != 0.0]
    gains = np.array([finger.spread_gain for finger in moving])
    return np.asarray(joints[:, [finger.spread_joint for finger in moving]] / gains)
