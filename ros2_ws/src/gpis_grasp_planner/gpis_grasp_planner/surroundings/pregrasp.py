"""A pre-grasp just wide enough, from which the fingers arrive together.

Open fingers reach far beyond the part and into whatever stands beside it. Since the fingers of
the narrow pre-grasp lie on the way from open to closed, and the drive's law has no memory before
the first contact, closing from either ends in the same grasp (up to the closing's tolerance).

A finger that meets the part before the others pushes it along until they come. So fingers that have
less way to their contact than the last one start wider by the difference: all motors run at one
speed, and the contacts come together.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.gjk import polytope_distance
from gpis_grasp_planner.geometry.transforms import apply
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.hand_motion import HandPieces, shifted
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.drive import (
    joints_from_motors,
    motors_from_joints,
    reachable,
    touch_motors,
)
from gpis_grasp_planner.hand.finger import Finger
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.surroundings.sweep_distance import distances_from_tree

Array = NDArray[np.float64]

_STEP_RAD = 0.05
_FINGERS_APART_M = 0.002


def narrow_pregrasp(
    hand: HandDescription,
    grasps: Sequence[Grasp],
    tree: TriangleTree,
    clearance_m: float,
    together: bool = False,
) -> list[Grasp]:
    """The grasps with each finger's pre-grasp closed until it would come within a clearance.

    The clearance [m] from the part holds in the pre-grasp and on the whole approach. A finger
    that is nearer than that when open stays as it is; so does a hand whose fingers would come
    near each other, or whose pre-grasp the drive cannot hold.

    Parameters
    ----------
    hand : HandDescription
    grasps : sequence of Grasp
    tree : TriangleTree
        Of the part, in its own frame.
    clearance_m : float [m]
        Should exceed what the part's pose may be wrong by, or the fingers meet the part on the
        approach.
    together : bool
        Start the touching fingers so that they arrive together, where that stays as free.

    Notes
    -----
    5 to 70 ms a grasp on meshes of 3,500 to 9,000 triangles.
    """
    if not grasps:
        return []
    opened = np.stack([g.pregrasp_joints for g in grasps])
    closed = np.stack([g.joints for g in grasps])
    preshape, start = motors_from_joints(hand, opened)
    held = hand.of_fingers(closed)[..., :-1]
    touch = touch_motors(hand, closed)
    _, end = motors_from_joints(hand, closed)
    motors = start.copy()
    can = (end > start) & reachable(hand, opened)[:, None]

    def free(trial: Array, asked: NDArray[np.bool_], approach: bool) -> NDArray[np.bool_]:
        joints = joints_from_motors(hand, preshape, trial, held)
        return _fingers_are_free(hand, grasps, joints, tree, clearance_m, asked, approach)

    step = _STEP_RAD * hand.closing_unit
    going = can.copy()
    while going.any():
        trial = np.where(going, np.minimum(motors + step, end), motors)
        going &= free(trial, going, approach=False)
        motors = np.where(going, trial, motors)
        going &= motors < end - 1e-9
    if hand.drive.coupled:  # as wide as the widest
        motors = np.repeat(motors.min(axis=1, keepdims=True), motors.shape[1], axis=1)
    # the approach is seldom nearer than its end: it is looked at once, and then on the way back
    wide = can & (motors > start)
    while wide.any():
        wide &= ~free(motors, wide, approach=True)
        if hand.drive.coupled:
            wide[:] = wide.any(axis=1, keepdims=True)
        motors = np.where(wide, np.maximum(motors - step, start), motors)
        wide &= motors > start
    if together:
        touches = can & _touching(hand, grasps)
        way = np.where(touches, np.minimum(touch, end) - motors, -np.inf)
        longest = way.max(axis=1, keepdims=True)
        wider = np.where(touches, np.maximum(motors - (longest - way), start), motors)
        moved = wider < motors - 1e-9
        as_free = free(wider, moved, approach=True) | ~moved
        motors = np.where(as_free.all(axis=1, keepdims=True), wider, motors)
    narrow = joints_from_motors(hand, preshape, motors, held)
    return [
        grasp if _fingers_meet(hand, joints) else replace(grasp, pregrasp_joints=joints)
        for grasp, joints in zip(grasps, narrow, strict=True)
    ]


def is_open(hand: HandDescription, grasp: Grasp) -> bool:
    """Whether a grasp closes from fully open fingers."""
    joints = [finger.inner_joint for finger in hand.fingers]
    return bool((grasp.pregrasp_joints[joints] <= hand.joint_lower[joints] + 1e-9).all())


def timed_pregrasp(
    hand: HandDescription, grasps: Sequence[Grasp], tree: TriangleTree, clearance_m: float
) -> list[Grasp]:
    """The grasps with fingers started as wide as can be so that they arrive together.

    Where nothing stands around there is no need to be narrow: the finger with the shortest way
    stays as it is, and the others start closed by what they have more. A hand whose fingers would
    not keep the clearance so, or come near each other, stays as it is. Some 0.6 ms a grasp;
    parameters as of :func:`narrow_pregrasp`.
    """
    if not grasps:
        return []
    opened = np.stack([g.pregrasp_joints for g in grasps])
    closed = np.stack([g.joints for g in grasps])
    preshape, start = motors_from_joints(hand, opened)
    _, end = motors_from_joints(hand, closed)
    held = hand.of_fingers(closed)[..., :-1]
    touch = touch_motors(hand, closed)
    touches = _touching(hand, grasps) & reachable(hand, opened)[:, None]
    way = np.where(touches, np.minimum(touch, end) - start, np.inf)
    later = np.where(touches, way - way.min(axis=1, keepdims=True), 0.0)
    moved = later > 1e-9
    joints = joints_from_motors(hand, preshape, start + np.where(moved, later, 0.0), held)
    free = _fingers_are_free(hand, grasps, joints, tree, clearance_m, moved, True) | ~moved
    better = np.asarray(free.all(axis=1) & moved.any(axis=1))
    return [
        replace(grasp, pregrasp_joints=joints[row])
        if better[row] and not _fingers_meet(hand, joints[row])
        else grasp
        for row, grasp in enumerate(grasps)
    ]


def arrival_spread_s(hand: HandDescription, grasp: Grasp) -> float:
    """Time [s] between the first and the last finger's contact when all close from the pre-grasp.

    By the motors' ways and speeds; 0 where fewer than two fingers touch.
    """
    touches = _touching(hand, [grasp])[0]
    _, start = motors_from_joints(hand, grasp.pregrasp_joints)
    _, end = motors_from_joints(hand, grasp.joints)
    touch = touch_motors(hand, grasp.joints)[0]
    times = (np.minimum(touch, end[0]) - start[0]) / hand.drive.motor_speed
    return float(np.ptp(times[touches])) if touches.sum() > 1 else 0.0


def _touching(hand: HandDescription, grasps: Sequence[Grasp]) -> NDArray[np.bool_]:
    """Which fingers (B, F) have contacts."""
    return np.array(
        [
            [bool(np.isin(grasp.contacts.links, f.links).any()) for f in hand.fingers]
            for grasp in grasps
        ]
    )


def _fingers_are_free(
    hand: HandDescription,
    grasps: Sequence[Grasp],
    joints: Array,
    tree: TriangleTree,
    clearance: float,
    asked: NDArray[np.bool_],
    approach: bool,
) -> NDArray[np.bool_]:
    """Whether fingers (B, F) with postures (B, J) keep the clearance, on the approach as well."""
    pieces = HandPieces.of(hand)
    T_palm_link = link_transforms(hand, joints)
    T = np.stack([g.T_object_palm for g in grasps])[:, None] @ T_palm_link
    back = np.stack([-g.approach_distance * g.approach_direction for g in grasps])
    T_back = shifted(T, back) if approach else T
    free = asked.copy()
    for index, finger in enumerate(hand.fingers):
        rows = np.flatnonzero(asked[:, index])
        members = _pieces_of(pieces, finger)
        which = np.tile(members, len(rows))
        first, last = (
            ends[np.ix_(rows, pieces.link[members])].reshape(-1, 4, 4) for ends in (T_back, T)
        )
        limit = np.full(len(which), clearance)
        distance = distances_from_tree(tree, pieces, which, first, last, limit)
        free[rows, index] = distance.reshape(len(rows), len(members)).min(axis=1) >= clearance
    return free


def _fingers_meet(hand: HandDescription, joints: Array) -> bool:
    """Whether moving links of different fingers come nearer than 2 mm."""
    pieces = HandPieces.of(hand)
    T = link_transforms(hand, joints)[0]
    placed = [
        [
            apply(T[pieces.link[k]], pieces.vertices[pieces.start[k] : pieces.start[k + 1]])
            for k in _pieces_of(pieces, finger)
        ]
        for finger in hand.fingers
    ]
    direction, p, q = np.empty(3), np.empty(3), np.empty(3)
    for one, other in itertools.combinations(placed, 2):
        for a, b in itertools.product(one, other):
            direction[:] = a.mean(axis=0) - b.mean(axis=0)
            if polytope_distance(a, b, _FINGERS_APART_M, direction, p, q) < _FINGERS_APART_M:
                return True
    return False


def _pieces_of(pieces: HandPieces, finger: Finger) -> NDArray[np.int64]:
    return np.flatnonzero(np.isin(pieces.link, finger.links))
