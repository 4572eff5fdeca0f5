"""Forward kinematics of a hand, for many joint vectors at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from gpis_grasp_planner.hand.description import HandDescription

Array = NDArray[np.float64]


def link_transforms(hand: HandDescription, joint_positions: ArrayLike) -> Array:
    """Poses of all links in the palm frame.

    Parameters
    ----------
    hand : HandDescription
    joint_positions : (B, J) array [rad, or m where a joint slides]
        In the order of ``hand.joint_names``.

    Returns
    -------
    T_palm_link : (B, L, 4, 4) array

    Notes
    -----
    About 5 us per joint vector in batches of 100 or more, 0.2 ms for a single one.
    """
    q = np.atleast_2d(np.asarray(joint_positions, dtype=float))
    T_palm_link = np.empty((len(q), hand.n_links, 4, 4))
    for link in range(hand.n_links):
        T_parent_link = hand.T_parent_joint[link]
        joint = hand.link_joint[link]
        if joint >= 0:
            moved = translation_along if hand.joint_slides[joint] else rotation_about
            T_parent_link = T_parent_link @ moved(hand.joint_axis[link], q[:, joint])
        parent = hand.link_parent[link]
        if parent >= 0:
            T_parent_link = T_palm_link[:, parent] @ T_parent_link
        T_palm_link[:, link] = T_parent_link
    return T_palm_link


def rotation_about(axis: Array, angle: Array) -> Array:
    """Transforms (B, 4, 4) that turn by angles (B,) [rad] about a unit axis (3,) (Rodrigues)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    T = np.zeros((len(angle), 4, 4))
    T[:, :3, :3] = (
        np.eye(3)
        + np.sin(angle)[:, None, None] * K
        + (1.0 - np.cos(angle))[:, None, None] * (K @ K)
    )
    T[:, 3, 3] = 1.0
    return T


def translation_along(axis: Array, distance: Array) -> Array:
    """Transforms (B, 4, 4) that move by distances (B,) [m] along a unit axis (3,)."""
    T = np.tile(np.eye(4), (len(distance), 1, 1))
    T[:, :3, 3] = distance[:, None] * axis
    return T
