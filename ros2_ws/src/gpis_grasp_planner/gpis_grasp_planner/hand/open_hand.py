"""Where a URDF's joints have the open hand, and which way they close.

The planner counts a joint that closes from 0, where the hand is open, to positive values. Makers
count otherwise: grippers open towards positive values, joints close towards negative ones, and one
that mimics another has an offset. The tree is counted anew when a hand is read, and what leaves the
planner (messages, documents) is counted as the URDF does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.hand.kinematics import rotation_about
from gpis_grasp_planner.hand.urdf import UrdfTree

Array = NDArray[np.float64]

_SAME = 1e-9
_NEAR = 1e-3  # of a joint's range: a limit that was rounded


@dataclass(frozen=True, eq=False)
class JointCount:
    """How the URDF counts joints: its value is `zero` + `sense` times the planner's.

    Attributes
    ----------
    zero : (J,) array [rad or m]
        The URDF's value where the planner's is 0.
    sense : (J,) array
        1 or -1.
    """

    zero: Array
    sense: Array

    def of_urdf(self, joints: ArrayLike) -> Array:
        """The URDF's values (..., J) of the planner's."""
        return np.asarray(self.zero + self.sense * np.asarray(joints, dtype=float))

    def of_planner(self, values: ArrayLike) -> Array:
        """The planner's joints (..., J) of the URDF's values."""
        return np.asarray(self.sense * (np.asarray(values, dtype=float) - self.zero))


def read_joint_count(tree: UrdfTree, fingers: Sequence[Mapping[str, Any]]) -> JointCount:
    """From the fingers' entries of the YAML file.

    Where nothing is said the open hand has a joint at 0, or where its <mimic> puts it; it closes
    towards its upper limit, or towards the lower one if the open hand has it at the upper one.

    Raises
    ------
    RequestError
        If an entry does not fit the finger's joints.
    """
    given: dict[int, float] = {}
    towards: dict[int, str] = {}
    closing: list[int] = []
    for finger in fingers:
        joints = [tree.joint_names.index(n) for n in finger["joints"] if n in tree.joint_names]
        closing += joints
        if "open_mm" in finger or "open_deg" in finger:
            slides = bool(tree.joint_slides[joints].any())
            if ("open_mm" in finger) != slides:
                raise RequestError(
                    f"Finger '{finger['name']}' {'slides' if slides else 'turns'}; give "
                    f"'open_{'mm' if slides else 'deg'}', where the URDF has its joints when open."
                )
            values = _each(finger, "open_mm" if slides else "open_deg", len(joints))
            for joint, value in zip(joints, values, strict=True):
                at = float(value) / 1000.0 if slides else float(np.radians(float(value)))
                given[joint] = _at_limit(tree, joint, at)
        if "closes_towards" in finger:
            ends = _each(finger, "closes_towards", len(joints))
            if not set(ends) <= {"lower", "upper"}:
                raise RequestError(
                    f"Finger '{finger['name']}' has 'closes_towards' {finger['closes_towards']!r};"
                    " give 'lower' or 'upper', which limit in the URDF its joints close towards."
                )
            towards |= dict(zip(joints, ends, strict=True))

    def opened(joint: int, asked: tuple[int, ...] = ()) -> float:
        mimic = tree.joint_mimic[joint]
        if joint in given or mimic is None or joint in asked or mimic[0] not in closing:
            return given.get(joint, 0.0)
        master, multiplier, offset = mimic
        return multiplier * opened(master, (*asked, joint)) + offset

    zero, sense = np.zeros(len(tree.joint_names)), np.ones(len(tree.joint_names))
    for joint in closing:
        zero[joint] = opened(joint)
        upper = float(tree.joint_upper[joint])
        at_upper = upper > tree.joint_lower[joint] and zero[joint] > upper - _SAME
        if towards.get(joint, "lower" if at_upper else "upper") == "lower":
            sense[joint] = -1.0
    return JointCount(zero, sense)


def counted_from_open(tree: UrdfTree, count: JointCount) -> UrdfTree:
    """The same tree with its joints counted from where the open hand has them."""
    if not count.zero.any() and (count.sense == 1.0).all():
        return tree
    T_parent_joint, joint_axis = tree.T_parent_joint.copy(), tree.joint_axis.copy()
    for link, joint in enumerate(tree.link_joint):
        if joint < 0:
            continue
        axis, zero = tree.joint_axis[link], count.zero[joint]
        if tree.joint_slides[joint]:
            moved = transform(np.eye(3), zero * axis)
        else:
            moved = rotation_about(axis, np.array([zero]))[0]
        T_parent_joint[link] = tree.T_parent_joint[link] @ moved
        joint_axis[link] = count.sense[joint] * axis
    limits = np.stack([count.of_planner(tree.joint_lower), count.of_planner(tree.joint_upper)])
    limits[np.abs(limits) < _SAME] = 0.0
    return replace(
        tree,
        T_parent_joint=T_parent_joint,
        joint_axis=joint_axis,
        joint_lower=limits.min(axis=0),
        joint_upper=limits.max(axis=0),
        joint_mimic=tuple(
            None if mimic is None else _mimic(joint, mimic, count)
            for joint, mimic in enumerate(tree.joint_mimic)
        ),
    )


def _at_limit(tree: UrdfTree, joint: int, value: float) -> float:
    """The limit of a joint that a value means, or the value."""
    low, high = float(tree.joint_lower[joint]), float(tree.joint_upper[joint])
    near = _NEAR * (high - low)
    return next((end for end in (low, high) if abs(value - end) <= near), value)


def _mimic(
    joint: int, mimic: tuple[int, float, float], count: JointCount
) -> tuple[int, float, float]:
    master, multiplier, offset = mimic
    offset += multiplier * count.zero[master] - count.zero[joint]
    sense = float(count.sense[joint])
    return master, sense * float(count.sense[master]) * multiplier, sense * float(offset)


def _each(finger: Mapping[str, Any], key: str, n: int) -> list[Any]:
    """A value for each of a finger's joints: a list of them, or one for all."""
    given = finger[key]
    values = list(given) if isinstance(given, list) else [given] * n
    if len(values) != n:
        raise RequestError(
            f"Finger '{finger['name']}' has '{key}' {given!r}; give one for all of its {n} joints, "
            "or one for each."
        )
    return values
