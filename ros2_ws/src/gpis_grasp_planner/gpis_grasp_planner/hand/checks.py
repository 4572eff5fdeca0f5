"""What may be wrong with a hand's description although it can be read."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.gjk import polytope_distance
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.transforms import apply
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.drive import joints_from_motors
from gpis_grasp_planner.hand.kinematics import link_transforms

Array = NDArray[np.float64]

_CONVEX_M = 1e-5
_ON_SURFACE_M = 1e-3
_LARGEST_M = 1.0
_CLOSED_STEPS = 21
_SAME_RAD = 1e-3
_SAME_SHARE = 0.01


def faults_of(hand: HandDescription) -> list[str]:
    """Sentences, each with a fault of a hand that would make bad plans; none where all is well.

    Looked at are the shapes (there, closed, convex, of a hand's size), the wanted contacts (on
    their links), the masses of moving links, the motors (their ends are those of their joints, the
    pre-shape keeps its joints within their limits), and the closing (fingers move, do not overlap
    when open, and come nearer to what they close towards).
    Some 20 ms.
    """
    return [
        *_shape_faults(hand),
        *_contact_faults(hand),
        *_mass_faults(hand),
        *_motor_faults(hand),
        *_mimic_faults(hand),
        *_closing_faults(hand),
    ]


def fingertip_gaps(hand: HandDescription, share: Array) -> Array:
    """Smallest distance (n,) [m] of two fingers, motors at shares (n,) of their way; 0: meet.

    The pre-shape's motors are at their lower ends.
    """
    motors = np.asarray(share)[:, None] * hand.drive.motor_upper
    joints = joints_from_motors(hand, np.tile(hand.preshape.lower, (len(motors), 1)), motors)
    poses = link_transforms(hand, joints)
    return np.array([_nearest_fingers(hand, T) for T in poses])


def _shape_faults(hand: HandDescription) -> list[str]:
    faults = []
    for name, pieces in zip(hand.link_names, hand.link_collision, strict=True):
        if not pieces:
            faults.append(f"Link '{name}' has no collision shape; give it a box or a convex STL.")
        for number, piece in enumerate(pieces, start=1):
            heights = piece.vertices @ piece.face_normals_outward.T - np.einsum(
                "ij,ij->i", piece.face_normals_outward, piece.triangles[:, 0]
            )
            if (out := float(heights.max())) > _CONVEX_M:
                faults.append(
                    f"Piece {number} of link '{name}' is not convex, or its faces point inwards: a "
                    f"corner lies {1e3 * out:.2f} mm outside of a face. Divide it into convex "
                    "pieces."
                )
    extents = [np.ptp(p.vertices, axis=0).max() for link in hand.link_collision for p in link]
    if extents and max(extents) > _LARGEST_M:
        faults.append(
            f"A shape is {max(extents):.1f} m long; a hand's are below {_LARGEST_M:g} m. URDF "
            "lengths are metres."
        )
    return faults


def _contact_faults(hand: HandDescription) -> list[str]:
    wanted = hand.desired_contacts
    faults = []
    for link, point in zip(wanted.links, wanted.points, strict=True):
        nearest = min(
            (abs(_height(piece, point)) for piece in hand.link_collision[link]), default=np.inf
        )
        if nearest > _ON_SURFACE_M:
            x, y, z = 1e3 * point
            faults.append(
                f"The wanted contact ({x:.1f}, {y:.1f}, {z:.1f}) mm of link "
                f"'{hand.link_names[link]}' is {1e3 * nearest:.1f} mm from its surface; put it on "
                "the surface."
            )
    for finger in hand.fingers:
        if not np.isin(wanted.links, finger.links).any():
            faults += [f"Finger '{finger.name}' has no wanted contact; give it one at least."]
    return faults


def _mass_faults(hand: HandDescription) -> list[str]:
    moving = [link for finger in hand.fingers for link in finger.links]
    return [
        f"Link '{hand.link_names[link]}' has a mass of {hand.link_mass[link]:g} kg; trials in "
        "physics need more than 0."
        for link in moving
        if not hand.link_mass[link] > 0.0
    ]


def _motor_faults(hand: HandDescription) -> list[str]:
    """Motors whose ends contradict those of their joints."""
    faults = []
    shape = hand.preshape
    corners = np.array(list(product(*zip(shape.lower, shape.upper, strict=True))))
    reached = corners @ shape.gain
    for joint, least, most in zip(shape.joints, reached.min(0), reached.max(0), strict=True):
        low, high = hand.joint_lower[joint], hand.joint_upper[joint]
        if not (low - _SAME_RAD <= least and most <= high + _SAME_RAD):
            faults.append(
                f"The pre-shape takes joint '{hand.joint_names[joint]}' from {least:.4f} to "
                f"{most:.4f}, but its limits are {low:.4f} and {high:.4f}; change the ends or the "
                "gains of the pre-shape's motors."
            )
    for finger, name, has in zip(
        hand.fingers, hand.drive.motor_names, hand.drive.motor_upper, strict=True
    ):
        own, ratio = hand.joint_upper[list(finger.joints)], finger.closing_ratio[0]
        if hand.drive.advances_at_stop:
            ends = float(own.sum() / ratio.sum())
        else:  # where the first joint of the first row comes to its limit
            ends = float((own[ratio > 0.0] / ratio[ratio > 0.0]).min())
        if abs(has - ends) > _SAME_SHARE * ends:
            faults.append(
                f"Motor '{name}' of finger '{finger.name}' ends at {has:.4f}, but by the closing "
                f"table its joints do at {ends:.4f}; set its motor_upper to that."
            )
    return faults


def _mimic_faults(hand: HandDescription) -> list[str]:
    """Joints that the URDF couples for good, and that closing moves on by themselves."""
    if hand.drive.breakaway_torque > 0.0 or hand.drive.advances_at_stop:
        return []
    names = hand.joint_names
    return [
        f"The URDF says that joint '{names[joint]}' always follows '{names[mimic[0]]}', but "
        "closing moves it on alone where a link before it is held: finger "
        f"'{finger.name}' may be asked for postures that the real one cannot reach. If a clutch or "
        "a spring frees it, give 'breakaway_torque'; if not, make the joint fixed in the URDF."
        for finger in hand.fingers
        for joint in finger.joints
        if (mimic := hand.joint_mimic[joint]) is not None and mimic[0] in finger.joints
    ]


def _closing_faults(hand: HandDescription) -> list[str]:
    faults = []
    ends = (("lower", hand.joint_lower), ("upper", hand.joint_upper))
    for name, lower, upper in zip(
        hand.joint_names, hand.joint_lower, hand.joint_upper, strict=True
    ):
        if not lower < upper:
            faults.append(f"Joint '{name}' goes from {lower:g} to {upper:g}; give it a range.")
    for which, values in ends:
        if not np.isfinite(values).all():
            faults.append(f"A joint has no {which} limit.")
    if faults:
        return faults
    if fingertip_gaps(hand, np.zeros(1))[0] <= 0.0:
        return ["Fingers overlap each other when the hand is open; move them apart in the URDF."]
    gaps = fingertip_gaps(hand, np.linspace(0.0, 1.0, _CLOSED_STEPS))
    if gaps.min() >= gaps[0]:
        faults.append(
            f"The fingers come no nearer to each other by closing: they are {1e3 * gaps[0]:.1f} mm "
            "apart when open. Joints close towards positive values; turn the axes in the URDF."
        )
    return faults


def _height(piece: TriangleMesh, point: Array) -> float:
    """Largest distance of a point over the planes of a convex piece's faces."""
    normals = piece.face_normals_outward
    return float((np.einsum("ij,ij->i", normals, point - piece.triangles[:, 0])).max())


def _nearest_fingers(hand: HandDescription, T_palm_link: Array) -> float:
    placed = [
        [
            apply(T_palm_link[link], np.asarray(piece.vertices, dtype=float))
            for link in finger.links
            for piece in hand.link_collision[link]
        ]
        for finger in hand.fingers
    ]
    best = _LARGEST_M
    p, q = np.empty(3), np.empty(3)
    for one, pieces in enumerate(placed):
        for others in placed[one + 1 :]:
            for a in pieces:
                for b in others:
                    direction = a.mean(axis=0) - b.mean(axis=0)
                    best = min(best, float(polytope_distance(a, b, best, direction, p, q)))
    return best
