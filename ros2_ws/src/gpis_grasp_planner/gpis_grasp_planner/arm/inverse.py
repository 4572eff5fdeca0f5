"""All inverse kinematics of an arm, by subproblem decomposition.

Ostermeier, Kuelz, Althoff: Automatic Geometric Decomposition for Analytical Inverse Kinematics,
IEEE RA-L 10(10), 2025: every branch of a six-axis arm in closed form, some 10 us. A seven-axis
arm has a joint that is set to each of a number of angles; the other six follow.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.arm.description import ArmDescription
from gpis_grasp_planner.arm.kinematics import flange_poses, link_poses
from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.transforms import rotation_angle

Array = NDArray[np.float64]

_TURN = 2.0 * np.pi
# What a solution must reach; the closed form has some 1e-12, its least-squares answers have not.
_POSITION_M, _ANGLE_RAD = 1e-5, 1e-5
_ROUNDING_RAD = 1e-9


@dataclass(frozen=True)
class _Slice:
    """The arm with its redundant joint at one angle; without one, the arm."""

    solver: Any
    angle: float


class ArmInverse:
    """Inverse kinematics of one arm, in its base's frame.

    Parameters
    ----------
    arm : ArmDescription
    locked_values : int
        Angles of the redundant joint, evenly over its range and from its middle outwards.

    Raises
    ------
    RequestError
        If the library is not installed, or the arm's axes are of no family that it decomposes.
    """

    def __init__(self, arm: ArmDescription, locked_values: int = 48):
        try:
            from eaik.pybindings.EAIK import Robot
        except ImportError as error:
            raise RequestError(
                f"An arm is set ({arm.name}), and the library for it is not installed: {error}. "
                "Install the extra 'arm' of gpis_grasp_planner, or leave arm.model empty."
            ) from error
        self.chain = chain = arm.chain
        n = arm.n_joints
        T = link_poses(chain, np.zeros((1, n)))[0]
        H = np.einsum("nij,nj->ni", T[1:-1, :3, :3], chain.joint_axis)
        P = np.diff(T[:, :3, 3], axis=0)  # base to joint 1, ..., joint n to flange
        redundant = arm.redundant_joint
        if n != 6 + (redundant is not None):
            raise RequestError(
                f"The arm '{arm.name}' has {n} joints and "
                f"{'no' if redundant is None else 'a'} redundant one; arms have six, or seven with "
                "'redundant_joint' in their YAML."
            )
        angles: list[float] = [0.0]
        if redundant is not None:
            low, high = chain.joint_lower[redundant], chain.joint_upper[redundant]
            # middles of equal parts: no angle lies on a limit
            even = low + (high - low) * (np.arange(locked_values) + 0.5) / locked_values
            angles = sorted(even.tolist(), key=lambda angle: abs(angle - 0.5 * (low + high)))
        self.slices = tuple(
            _Slice(
                Robot(H.T, P.T, T[-1, :3, :3], [] if redundant is None else [(redundant, a)], True),
                a,
            )
            for a in angles
        )
        if not self.slices[0].solver.has_known_decomposition():
            raise RequestError(
                f"The axes of the arm '{arm.name}' are of no family that is solved in closed form "
                "(three parallel or three intersecting neighbours, among others); see docs/arm.md."
            )
        self._reach, self._middle = _outer_ball(T[:, :3, 3], H)

    def within_ball(self, T_base_flange: Array) -> NDArray[np.bool_]:
        """Which flanges (B, 4, 4) are not farther than the arm's links are long (B,)."""
        gap = np.linalg.norm(T_base_flange[:, :3, 3] - self._middle, axis=1)
        return np.asarray(gap <= self._reach + _POSITION_M)

    def solutions(self, T_base_flange: Array, slice_: int = 0) -> list[Array]:
        """All postures that reach each of B flanges (B, 4, 4): B arrays (S, n) [rad].

        In (-pi, pi], whatever the limits (`within_limits`); of one value of the redundant joint.
        """
        joints, row = self._all(T_base_flange, slice_)
        return np.split(joints, np.searchsorted(row, np.arange(1, len(T_base_flange))))

    def reachable(self, T_base_flange: Array) -> NDArray[np.bool_]:
        """Which flanges (B, 4, 4) some posture within the limits reaches (B,).

        10 us each, for a seven-axis arm as many times as values of its joint have to be tried.
        """
        free = np.zeros(len(T_base_flange), dtype=np.bool_)
        left = np.flatnonzero(self.within_ball(T_base_flange))
        for number in range(len(self.slices)):
            if not len(left):
                break
            joints, row = self._all(T_base_flange[left], number)
            hit = np.zeros(len(left), dtype=np.bool_)
            hit[row[np.isfinite(self.turned(joints[:, None])).all(axis=(1, 2))]] = True
            free[left[hit]] = True
            left = left[~hit]
        return free

    def within_limits(self, joints: Array) -> Array:
        """Those of postures (S, n) that can be turned by whole turns into the limits, so turned."""
        turned = self.turned(joints[:, None])[:, 0]
        return np.asarray(turned[np.isfinite(turned).all(axis=1)])

    def turned(self, ways: Array) -> Array:
        """Ways (S, K, n) with each joint moved by whole turns so that all of it is in the limits.

        Of several such turns the one nearest to the limits' middle; NaN where there is none.
        """
        if not len(ways):
            return ways
        lower, upper = self.chain.joint_lower, self.chain.joint_upper
        low, high = ways.min(axis=1), ways.max(axis=1)
        wanted = np.round((0.5 * (lower + upper) - 0.5 * (low + high)) / _TURN)
        fewest = np.ceil((lower - low - _ROUNDING_RAD) / _TURN)
        most = np.floor((upper - high + _ROUNDING_RAD) / _TURN)
        turns = np.where(fewest <= most, np.clip(wanted, fewest, most), np.nan)
        return np.asarray(ways + _TURN * turns[:, None])

    def _all(self, T: Array, number: int) -> tuple[Array, NDArray[np.intp]]:
        """Postures (R, n) of all flanges (B, 4, 4), and the flange (R,) of each, in order.

        Those of least squares only where they reach the flange all the same.
        """
        found = self.slices[number].solver.calculate_IK_batched(T, 1)
        counts = [len(one.Q) for one in found]
        n = len(self.chain.joint_names)
        joints = np.array([q for one in found for q in one.Q], dtype=np.float64).reshape(-1, n)
        row = np.repeat(np.arange(len(T)), counts)
        estimate = np.flatnonzero([flag for one in found for flag in one.is_LS])
        good = np.ones(len(joints), dtype=np.bool_)
        if len(estimate):
            at, to = flange_poses(self.chain, joints[estimate]), T[row[estimate]]
            near = np.linalg.norm(at[:, :3, 3] - to[:, :3, 3], axis=1) <= _POSITION_M
            angle = rotation_angle(at[:, :3, :3], to[:, :3, :3])
            good[estimate] = near & (angle <= _ANGLE_RAD)
        return joints[good], row[good]


def _outer_ball(points: Array, axes: Array) -> tuple[float, Array]:
    """Radius and middle of a ball that the flange never leaves: the links' lengths added.

    About the second joint where that lies on the first one's axis, else about the first.
    """
    offset = points[2] - points[1]
    first = 2 if np.linalg.norm(np.cross(offset, axes[0])) < 1e-9 else 1
    lengths = np.linalg.norm(np.diff(points[first:], axis=0), axis=1)
    return float(lengths.sum()), points[first]
