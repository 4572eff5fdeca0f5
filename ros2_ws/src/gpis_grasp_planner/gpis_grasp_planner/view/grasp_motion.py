"""The way to a grasp and up from it, as frames to be shown: approach, closing, lift.

Fingers close by the drive's law at the motors' speeds, the arm follows the joints that the plan
found. The lift of a grasp without an arm is for the eye only: nobody has looked whether it is free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.arm.description import ArmDescription
from gpis_grasp_planner.arm.kinematics import flange_poses
from gpis_grasp_planner.geometry.transforms import inverse
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.hand_motion import closing_in_time
from gpis_grasp_planner.hand.description import HandDescription

Array = NDArray[np.float64]

_CLOSING_FRAMES = 31
_WAY_FRAMES = 16
_LIFT_M = 0.1  # where no arm says how high


@dataclass(frozen=True, eq=False)
class MotionFrame:
    """One moment of the way.

    Attributes
    ----------
    phase : str
        "approach", "closing" or "lift".
    T_object_palm : (4, 4) array
        "Object" is the frame of the part before it is lifted.
    joints : (J,) array [rad]
        Of the hand.
    T_object_part : (4, 4) array
        Where the part has been carried to.
    arm_joints : (n,) array [rad] or None
    """

    phase: str
    T_object_palm: Array
    joints: Array
    T_object_part: Array
    arm_joints: Array | None = None


def grasp_motion(
    hand: HandDescription,
    grasp: Grasp,
    arm: ArmDescription | None = None,
    T_object_arm: Array | None = None,
) -> tuple[MotionFrame, ...]:
    """Frames from the approach's beginning to the lifted part.

    Parameters
    ----------
    hand : HandDescription
    grasp : Grasp
    arm : ArmDescription, optional
        Of a grasp with an arm's motion; the palm is then where the arm's joints bring it.
    T_object_arm : (4, 4) array, optional
        Frame in which the arm's file gives its base.
    """
    if grasp.arm is not None and arm is not None and T_object_arm is not None:
        coming, going = grasp.arm.approach, grasp.arm.lift
        T_palm = [_palms(arm, T_object_arm, joints) for joints in (coming, going)]
        arm_joints: tuple[Array | list[None], Array | list[None]] = (coming, going)
    else:
        share = np.linspace(0.0, 1.0, _WAY_FRAMES)
        back = -grasp.approach_distance * grasp.approach_direction
        T_palm = [
            _moved(grasp.T_object_palm, (1.0 - share)[:, None] * back),
            _moved(grasp.T_object_palm, share[:, None] * _LIFT_M * grasp.way_out),
        ]
        arm_joints = [None] * len(share), [None] * len(share)
    rest = np.eye(4)
    frames = [
        MotionFrame("approach", T, grasp.pregrasp_joints, rest, joints)
        for T, joints in zip(T_palm[0], arm_joints[0], strict=True)
    ]
    _, closing = closing_in_time(hand, grasp.pregrasp_joints, grasp.joints, _CLOSING_FRAMES)
    frames += [
        MotionFrame("closing", frames[-1].T_object_palm, joints, rest, frames[-1].arm_joints)
        for joints in closing[1:]
    ]
    T_palm_part = inverse(frames[-1].T_object_palm)
    frames += [
        MotionFrame("lift", T, grasp.joints, T @ T_palm_part, joints)
        for T, joints in zip(T_palm[1][1:], arm_joints[1][1:], strict=True)
    ]
    return tuple(frames)


def _palms(arm: ArmDescription, T_object_arm: Array, joints: Array) -> Array:
    return np.asarray(
        T_object_arm @ arm.T_arm_base @ flange_poses(arm.chain, joints) @ arm.T_flange_palm
    )


def _moved(T: Array, moves: Array) -> Array:
    moved = np.repeat(T[None], len(moves), axis=0)
    moved[:, :3, 3] += moves
    return moved
