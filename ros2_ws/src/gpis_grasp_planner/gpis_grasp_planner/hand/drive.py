"""Motors to joints and back, by the closing table: coupling, breakaway and stops.

One motor closes a finger of D joints. While the first h links are held, its joints move as row h of
the table says (`Drive.closing_ratio`); a link is held from where it touches on, or from its stop on
if the hand has such. The motor pulls on all joints alike: its angle counts the sum of their
motions, in units of the first joint's while nothing is held,

    m = (q_1 + ... + q_D) / (r_1 + ... + r_D),        r the table's first row.

For the Barrett, whose worm gears have the ratios 125 and 375, that is the firmware's law

    inner = M / 125,          distal = M / 375                       before breakaway,
    inner = held,             distal = M (1/125 + 1/375) - held      after it

with m = M / 125: distal = m / 3 before and 4/3 m - held after. Breakaway acts in closing only. A
finger of one link has its motor's position.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.hand.description import HandDescription

Array = NDArray[np.float64]

_AT_STOP = 1e-6


def joints_from_motors(
    hand: HandDescription,
    preshape: ArrayLike,
    motor: ArrayLike,
    held: ArrayLike = np.inf,
) -> Array:
    """Joint angles while the fingers close.

    Parameters
    ----------
    hand : HandDescription
    preshape : (B, S) array [rad or m]
        Of its motors.
    motor : (B, F) array [rad]
        Angles the first joints would have while nothing is held.
    held : (B, F, D - 1) array [rad], optional
        Angles at which all joints but the last were held, because their links touched; infinite
        where they were not. Before that a finger moves as if there were none. Ordered as by
        `HandDescription.of_fingers`.

    Returns
    -------
    joints : (B, J) array [rad]
        Clipped to the joints' limits.
    """
    drive = hand.drive
    motor = np.atleast_2d(np.asarray(motor, dtype=float))
    n = drive.n_links
    held = np.broadcast_to(np.asarray(held, dtype=float), (*motor.shape, n - 1))
    upper = hand.of_fingers(hand.joint_upper)
    gear, first = drive.row_gear, hand.first_joint
    q = np.zeros((*motor.shape, n))
    left = motor
    for h in range(n - 1):
        end = held[..., h]
        if drive.advances_at_stop:
            end = np.minimum(end, upper[:, h])
        way = np.minimum(left / gear[:, h], end - q[..., h])
        if h:  # a motor may be where an earlier link is held
            way = np.maximum(way, 0.0)
        way = np.where(h < first, 0.0, way)
        q += way[..., None] * drive.closing_ratio[:, h]
        left = left - way * gear[:, h]
    q[..., -1] = motor * drive.first_travel - q[..., :-1].sum(axis=-1)
    joints = np.zeros((len(motor), hand.n_joints))
    hand.preshape.put(joints, np.atleast_2d(np.asarray(preshape, dtype=float)))
    for index, finger in enumerate(hand.fingers):
        joints[:, list(finger.joints)] = q[:, index, -len(finger.joints) :]
    return np.clip(joints, hand.joint_lower, hand.joint_upper)


def motors_from_joints(hand: HandDescription, joints: ArrayLike) -> tuple[Array, Array]:
    """Motor angles (pre-shape (B, S), motor (B, F)) [rad] that hold joint angles (B, J).

    Inverse of :func:`joints_from_motors`, whatever is held. A posture that no drive reaches (a
    joint behind its coupling) still has a figure here; :func:`reachable` tells.
    """
    joints = np.atleast_2d(np.asarray(joints, dtype=float))
    q = hand.of_fingers(joints)
    return hand.preshape.of(joints), q.sum(axis=-1) / hand.drive.first_travel


def row_ends(hand: HandDescription, joints: ArrayLike) -> Array:
    """Motor angles (B, F, D - 1) [rad] at which the joints but the last came to where they are.

    From there on each of them is held in closed hands (B, J) [rad], and the next row moves. 0 for
    joints that a finger of fewer links does not have.
    """
    joints = np.atleast_2d(np.asarray(joints, dtype=float))
    q = hand.of_fingers(joints)
    gear = hand.drive.row_gear
    base = np.zeros_like(q)
    ends = np.zeros((*q.shape[:2], hand.drive.n_links - 1))
    motor = np.zeros(q.shape[:2])
    for h in range(hand.drive.n_links - 1):
        way = q[..., h] - base[..., h]
        motor = motor + gear[:, h] * way
        base += way[..., None] * hand.drive.closing_ratio[:, h]
        ends[..., h] = motor
    return ends


def touch_motors(hand: HandDescription, joints: ArrayLike) -> Array:
    """Motor angles (B, F) [rad] at which closed hands (B, J) [rad] had their first contact.

    Where the first link was held that is not at its stop, or where the finger is, if that comes
    first; of a finger that touches nothing a figure without meaning.
    """
    joints = np.atleast_2d(np.asarray(joints, dtype=float))
    _, end = motors_from_joints(hand, joints)
    if hand.drive.n_links == 1:
        return end
    ends = row_ends(hand, joints)
    none = np.arange(hand.drive.n_links - 1) < hand.first_joint[:, None]
    if hand.drive.advances_at_stop:
        inner, upper = (hand.of_fingers(x)[..., :-1] for x in (joints, hand.joint_upper))
        none = none | (inner >= upper - _AT_STOP)
    ends = np.where(none, end[..., None], ends)
    return np.asarray(ends.min(axis=-1))


def reachable(
    hand: HandDescription, joints: ArrayLike, tolerance: float = 1e-6
) -> NDArray[np.bool_]:
    """Whether joint vectors (B, J) lie within limits and can be driven to, (B,) bool.

    The pre-shape's joints must agree, as must the fingers of a coupled hand, and no joint may be
    behind its coupling.
    """
    joints = np.atleast_2d(np.asarray(joints, dtype=float))
    low = (joints >= hand.joint_lower - tolerance).all(axis=1)
    high = (joints <= hand.joint_upper + tolerance).all(axis=1)
    together = hand.preshape.agree(joints, tolerance)
    q = hand.of_fingers(joints)
    base = np.zeros_like(q)
    ahead = np.ones(len(joints), dtype=np.bool_)
    for h in range(hand.drive.n_links - 1):
        base += (q[..., h] - base[..., h])[..., None] * hand.drive.closing_ratio[:, h]
        ahead &= (q[..., h + 1] >= base[..., h + 1] - tolerance).all(axis=1)
    if hand.drive.coupled:
        together = together & (np.ptp(q[..., 0], axis=1) <= tolerance)
    return np.asarray(low & high & together & ahead)
