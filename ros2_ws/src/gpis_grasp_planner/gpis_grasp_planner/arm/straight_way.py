"""Straight ways of the flange as ways of the joints: one branch from end to end, without a jump."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.arm.inverse import ArmInverse
from gpis_grasp_planner.arm.kinematics import flange_poses
from gpis_grasp_planner.geometry.transforms import rotation_angle

Array = NDArray[np.float64]

_TURN = 2.0 * np.pi
# Of the flange's orientation between two samples.
_ANGLE_RAD = np.deg2rad(0.5)


def straight_line(T: Array, move: Array, step_m: float) -> Array:
    """Poses (K, 4, 4) from a pose (4, 4) to the same moved by (3,) [m], both ends included."""
    n = max(int(np.ceil(np.linalg.norm(move) / step_m - 1e-9)), 1)
    line = np.tile(T, (n + 1, 1, 1))
    line[:, :3, 3] += np.linspace(0.0, 1.0, n + 1)[:, None] * move
    return line


def follow(
    inverse: ArmInverse, start: Array, T_base_flange: Array, found: list[Array], deviation_m: float
) -> Array | None:
    """Joints (K, n) along a line from a posture at its first pose; None where the way ends.

    At each pose the posture nearest to the last one; the way ends where there is none, or where
    joints that move in proportion would take the flange off the line: at singular postures, and
    where the branch does not go on. Joints are not turned into their limits.

    Parameters
    ----------
    inverse : ArmInverse
    start : (n,) array [rad]
    T_base_flange : (K, 4, 4) array
    found : K arrays (S, n) [rad]
        All postures at each pose (`ArmInverse.solutions`).
    deviation_m : float [m]
        The largest distance of the flange from the line, halfway between two poses.
    """
    way = [start]
    for joints in found[1:]:
        if not len(joints):
            return None
        turn = joints - way[-1]
        turn -= _TURN * np.round(turn / _TURN)
        way.append(way[-1] + turn[np.abs(turn).max(axis=1).argmin()])
    joints = np.array(way)
    if len(joints) < 2:
        return joints
    halfway = flange_poses(inverse.chain, 0.5 * (joints[1:] + joints[:-1]))
    wanted = 0.5 * (T_base_flange[1:, :3, 3] + T_base_flange[:-1, :3, 3])
    off = np.linalg.norm(halfway[:, :3, 3] - wanted, axis=1)
    turned = rotation_angle(halfway[:, :3, :3], T_base_flange[:-1, :3, :3])
    if (off > deviation_m).any() or (turned > _ANGLE_RAD).any():
        return None
    return joints
