"""Motors to joints and back: coupling, TorqueSwitch breakaway, limits and travel times.

One worm-geared motor drives the inner and the distal joint of a finger. With the motor's angle M
and the gear ratios 125 and 375 the firmware's law is

    inner = M / 125,          distal = M / 375                       before breakaway,
    inner = held,             distal = M (1/125 + 1/375) - held      after it.

A finger of one link has its motor's position.

Here a motor angle is ``m = M / 125``, the inner angle it gives without breakaway, so that
distal = m / 3 before and 4/3 m - held after. Breakaway acts in closing only.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.hand.description import HandDescription

Array = NDArray[np.float64]


def joints_from_motors(
    hand: HandDescription,
    spread: ArrayLike,
    motor: ArrayLike,
    inner_stop: ArrayLike = np.inf,
) -> Array:
    """Joint angles while the fingers close.

    Parameters
    ----------
    hand : HandDescription
    spread : (B,) array [rad]
        Both spread joints follow it equally.
    motor : (B, n_fingers) array [rad]
        Angles the inner joints would have without breakaway.
    inner_stop : (B, n_fingers) array [rad], optional
        Inner angles at which the inner links were stopped and freed; infinite where they were
        not. Below its stop a finger moves as if there were none.

    Returns
    -------
    joints : (B, J) array [rad]
        Clipped to the joints' limits.
    """
    motor = np.atleast_2d(np.asarray(motor, dtype=float))
    inner = np.minimum(motor, inner_stop)
    ratio = hand.drive.distal_per_inner
    distal = motor * (1.0 + ratio) - inner
    joints = np.zeros((len(motor), hand.n_joints))
    for index, finger in enumerate(hand.fingers):
        if finger.spread_joint >= 0:
            joints[:, finger.spread_joint] = spread
        joints[:, finger.inner_joint] = inner[:, index]
        if len(finger.joints) > 1:
            joints[:, finger.distal_joint] = distal[:, index]
    return np.clip(joints, hand.joint_lower, hand.joint_upper)


def motors_from_joints(hand: HandDescription, joints: ArrayLike) -> tuple[Array, Array]:
    """Motor angles (spread (B,), motor (B, n_fingers)) [rad] that hold joint angles (B, J).

    Inverse of :func:`joints_from_motors` on both sides of the breakaway: the motor is
    (inner + distal) / (1 + 1/3). A posture that no drive reaches (distal below inner / 3) still
    has a figure here; :func:`reachable` tells.
    """
    joints = np.atleast_2d(np.asarray(joints, dtype=float))
    spreading = [finger.spread_joint for finger in hand.fingers if finger.spread_joint >= 0]
    spread = joints[:, spreading].mean(axis=1) if spreading else np.zeros(len(joints))
    inner = joints[:, [finger.inner_joint for finger in hand.fingers]]
    distal = joints[:, [finger.distal_joint for finger in hand.fingers]]
    both = (inner + distal) / (1.0 + hand.drive.distal_per_inner)
    return spread, np.where(hand.two_links, both, inner)


def reachable(
    hand: HandDescription, joints: ArrayLike, tolerance: float = 1e-6
) -> NDArray[np.bool_]:
    """Whether joint vectors (B, J) lie within limits and can be driven to, (B,) bool.

    The spread joints must agree, as must the fingers of a coupled hand, and no distal joint may be
    behind its coupling.
    """
    joints = np.atleast_2d(np.asarray(joints, dtype=float))
    low = (joints >= hand.joint_lower - tolerance).all(axis=1)
    high = (joints <= hand.joint_upper + tolerance).all(axis=1)
    spreading = [finger.spread_joint for finger in hand.fingers if finger.spread_joint >= 0]
    together = np.ptp(joints[:, spreading], axis=1) <= tolerance if spreading else np.array(True)
    inner = joints[:, [finger.inner_joint for finger in hand.fingers]]
    distal = joints[:, [finger.distal_joint for finger in hand.fingers]]
    ahead = (distal >= hand.drive.distal_per_inner * inner - tolerance).all(axis=1)
    if hand.drive.coupled:
        together = together & (np.ptp(inner, axis=1) <= tolerance)
    return np.asarray(low & high & together & ahead)


def motor_at_end(hand: HandDescription, inner_stop: ArrayLike) -> Array:
    """Largest useful motor angle [rad] of a finger whose inner link was stopped at `inner_stop`.

    The distal joint's limit or the motor's end, whichever comes first; any shape.
    """
    inner_stop = np.asarray(inner_stop, dtype=float)
    distal_upper = hand.joint_upper[hand.fingers[0].distal_joint]
    upper = float(hand.drive.motor_upper[1])
    held = np.minimum(inner_stop, upper)
    return np.minimum(upper, (held + distal_upper) / (1.0 + hand.drive.distal_per_inner))


def travel_time(hand: HandDescription, start: ArrayLike, end: ArrayLike) -> Array:
    """Time [s] each motor takes from `start` to `end`, (B, n_motors) [rad] at its full speed.

    Motors are ordered as ``hand.drive.motor_names``: spread, then the fingers.
    """
    travel = np.abs(np.asarray(end, dtype=float) - np.asarray(start, dtype=float))
    return np.asarray(travel / hand.drive.motor_speed)
