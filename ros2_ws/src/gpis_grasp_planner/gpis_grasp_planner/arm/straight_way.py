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
    inverse: ArmInverse,
    starts: Array,
    T_base_flange: Array,
    found: list[Array],
    deviation_m: float,
) -> tuple[NDArray[np.intp], Array]:
    """Ways of the joints along a line, from postures at its first pose.

    At each pose the posture nearest to the last one; a way ends where there is none, or where
    joints that move in proportion would take the flange off the line: at singular postures, and
    where the branch does not go on. Joints are not turned into their limits.

    Parameters
    ----------
    inverse : ArmInverse
    starts : (S, n) array [rad]
    T_base_flange : (K, 4, 4) array
    found : K arrays (S_k, n) [rad]
        All postures at each pose (`ArmInverse.solutions`); the first is not looked at.
    deviation_m : float [m]
        The largest distance of the flange from the line, halfway between two poses.

    Returns
    -------
    rows : (W,) int array
        The starts whose ways reach the other end.
    ways : (W, K, n) array [rad]
    """
    n = starts.shape[1]
    none = np.empty(0, dtype=np.intp), np.empty((0, len(T_base_flange), n))
    if not all(len(joints) for joints in found[1:]):
        return none
    way = [starts]
    for joints in found[1:]:
        turn = joints - way[-1][:, None]
        turn -= _TURN * np.round(turn / _TURN)
        nearest = np.abs(turn).max(axis=2).argmin(axis=1)
        way.append(way[-1] + turn[np.arange(len(starts)), nearest])
    ways = np.stack(way, axis=1)
    between = 0.5 * (ways[:, 1:] + ways[:, :-1])
    halfway = flange_poses(inverse.chain, between.reshape(-1, n))
    wanted = 0.5 * (T_base_flange[1:, :3, 3] + T_base_flange[:-1, :3, 3])
    R = np.tile(T_base_flange[:-1, :3, :3], (len(starts), 1, 1))
    off = np.linalg.norm(halfway[:, :3, 3] - np.tile(wanted, (len(starts), 1)), axis=1)
    good = (off <= deviation_m) & (rotation_angle(halfway[:, :3, :3], R) <= _ANGLE_RAD)
    rows = np.flatnonzero(good.reshape(len(starts), -1).all(axis=1))
    return rows, ways[rows]
