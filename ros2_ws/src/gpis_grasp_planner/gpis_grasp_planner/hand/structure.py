"""What the structure of a hand must be, so that closing, trials and pictures know it."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.hand.drive_train import check_limits
from gpis_grasp_planner.hand.kinematics import link_transforms

if TYPE_CHECKING:
    from gpis_grasp_planner.hand.description import HandDescription

_SAME_TRAVEL_M = 1e-6  # of two jaws


def check_joints(hand: HandDescription) -> None:
    """Refuse joints that close from elsewhere than 0, or the other way.

    Raises
    ------
    RequestError
        With the joint and its limits.
    """
    for finger in hand.fingers:
        for joint in finger.joints:
            lower, upper = float(hand.joint_lower[joint]), float(hand.joint_upper[joint])
            if lower != 0.0 or not upper > 0.0:
                raise RequestError(
                    f"Joint '{hand.joint_names[joint]}' of finger '{finger.name}' of "
                    f"'{hand.name}' goes from {lower:g} to {upper:g}, counted from the open hand "
                    f"the way it closes; 0 must be between. The URDF's value in the open hand is "
                    f"taken as {hand.joint_count.zero[joint]:g}: give the finger 'open_deg' or "
                    "'open_mm', and 'closes_towards' where it closes the other way."
                )


def check_structure(hand: HandDescription) -> None:
    """Refuse what the closing does not know (docs/decisions/hands.md).

    Raises
    ------
    RequestError
        With the link, joint or finger that is another.
    """
    _check_chains(hand)
    for finger in hand.fingers:
        slides = hand.joint_slides[list(finger.joints)]
        if slides.any() and len(finger.joints) > 1:
            raise RequestError(
                f"Finger '{finger.name}' of '{hand.name}' has a sliding joint among "
                f"{len(finger.joints)}; a finger that slides has that one joint only."
            )
    n_motors = len(hand.fingers)
    if len(hand.drive.motor_upper) != n_motors or len(hand.drive.motor_names) != n_motors:
        raise RequestError(
            f"The drive of '{hand.name}' names {len(hand.drive.motor_names)} motors with "
            f"{len(hand.drive.motor_upper)} limits; give {n_motors}, one for each finger. What is "
            "set before the hand closes is under 'preshape'."
        )
    n_degrees = len(hand.preshape) + n_motors
    if hand.eigengrasps.directions.shape[1:] != (n_degrees,):
        raise RequestError(
            f"The eigengrasps of '{hand.name}' are of the shape "
            f"{hand.eigengrasps.directions.shape}; give each {n_degrees} numbers: the pre-shape's "
            "motors, then one for each finger."
        )
    if hand.drive.coupled and not _is_parallel_pair(hand):
        raise RequestError(
            f"'{hand.name}' is coupled, which is known for two fingers that slide towards each "
            "other by the same amount only."
        )
    holding = hand.drive.coupled or hand.drive.independent
    if holding and not np.isfinite(hand.joint_effort).all():
        raise RequestError(
            f"Joints of '{hand.name}' hold with their effort, and the URDF gives the efforts "
            f"{hand.joint_effort.tolist()}; give each <limit effort='...'>."
        )
    for finger, motor in zip(hand.fingers, hand.drive.motor_upper, strict=True):
        check_limits(
            f"finger '{finger.name}' of '{hand.name}'",
            finger.closing_ratio,
            hand.joint_upper[list(finger.joints)],
            float(motor),
        )


def _check_chains(hand: HandDescription) -> None:
    """Each finger is a chain of its own whose links carry nothing else, and all have shapes."""
    moved = [link for finger in hand.fingers for link in finger.links]
    if len(set(moved)) != len(moved):
        raise RequestError(f"A joint of '{hand.name}' is named by two fingers; each has its own.")
    inner = {link: before for finger in hand.fingers for before, link in pairwise(finger.links)}
    for link, parent in enumerate(hand.link_parent):
        if inner.get(link, parent) != parent or (int(parent) in moved and link not in inner):
            raise RequestError(
                f"Link '{hand.link_names[link]}' of '{hand.name}' hangs on "
                f"'{hand.link_names[parent]}'; the links of a finger hang on each other, from the "
                "palm outwards, and carry nothing else that moves. A joint among them that shall "
                "stay where it is can be 'fixed' in the URDF."
            )
    for name, pieces in zip(hand.link_names, hand.link_collision, strict=True):
        if not pieces:
            raise RequestError(
                f"Link '{name}' of '{hand.name}' has no collision shape; give it one in the URDF."
            )


def _is_parallel_pair(hand: HandDescription) -> bool:
    joints = [joint for finger in hand.fingers for joint in finger.joints]
    if len(joints) != 2 or not hand.joint_slides[joints].all():
        return False
    T_palm_link = link_transforms(hand, np.zeros(hand.n_joints))[0]
    axes = [
        T_palm_link[link, :3, :3] @ hand.joint_axis[link]
        for finger in hand.fingers
        for link in finger.links
    ]
    same_travel = abs(float(np.diff(hand.joint_upper[joints])[0])) < _SAME_TRAVEL_M
    return bool(np.allclose(axes[0], -axes[1], atol=1e-6) and same_travel)
