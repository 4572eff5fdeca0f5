"""A finger as data: what closing moves, by which table, and where the fingertip presses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.hand.drive_train import closing_table
from gpis_grasp_planner.hand.urdf import UrdfTree

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Finger:
    """One finger: indices of its joints and links.

    Attributes
    ----------
    joints, links : tuples of int
        What closing moves, from the palm outwards.
    knuckle_link : int
        The link that carries the first of them.
    closing_ratio : (n, n) array
        Its closing table (`hand.drive_train`).
    tip_point : (3,) array [m]
        Where the fingertip presses, in the outermost link's frame.
    """

    name: str
    joints: tuple[int, ...]
    links: tuple[int, ...]
    knuckle_link: int
    closing_ratio: Array
    tip_point: Array

    @property
    def inner_joint(self) -> int:
        """The first joint that closes."""
        return self.joints[0]

    @property
    def distal_joint(self) -> int:
        """The last joint that closes; of a finger with one link, the same as the inner one."""
        return self.joints[-1]

    @property
    def inner_link(self) -> int:
        """The first link that closing moves."""
        return self.links[0]

    @property
    def distal_link(self) -> int:
        """The outermost link; of a finger with one link, the same as the inner one."""
        return self.links[-1]


def read_finger(tree: UrdfTree, entry: Mapping[str, Any], drive: Mapping[str, Any]) -> Finger:
    """A finger from its entry in the YAML file, and from the `drive` what holds for all fingers.

    Raises
    ------
    RequestError
        If it names a joint that is not there, or its closing table does not fit.
    """
    for name in entry["joints"]:
        if name not in tree.joint_names:
            raise RequestError(
                f"Finger '{entry['name']}' names a joint '{name}' that the URDF does not have; it "
                f"has {', '.join(tree.joint_names)}."
            )
    if not entry["joints"]:
        raise RequestError(f"Finger '{entry['name']}' has 0 closing joints; give it one at least.")
    if "spread_joint" in entry:
        raise RequestError(
            f"Finger '{entry['name']}' has a 'spread_joint'. What is set before the hand closes is "
            "under 'preshape' now: motors with their joints and gains; see docs/hands.md."
        )
    joints = tuple(tree.joint_names.index(name) for name in entry["joints"])
    moved_by = {int(joint): link for link, joint in enumerate(tree.link_joint) if joint >= 0}
    links = tuple(moved_by[joint] for joint in joints)
    tip_mm = entry["tip_point_mm"] if "tip_point_mm" in entry else drive["tip_point_mm"]
    return Finger(
        name=entry["name"],
        joints=joints,
        links=links,
        knuckle_link=int(tree.link_parent[links[0]]),
        closing_ratio=closing_table(drive, entry, len(links)),
        tip_point=np.array(tip_mm, dtype=float) / 1000.0,
    )
