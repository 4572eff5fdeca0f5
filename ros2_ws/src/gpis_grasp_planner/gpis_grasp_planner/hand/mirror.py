"""The hand's plane of symmetry, if it has one.

A hand that is its own mirror image grasps the mirror image of a place as it grasps the place.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.preshape import SLIDING_LEVER_M

_PRESHAPE_SHARE = 0.16
_LINKS_RAD = (0.7, 0.4)
_TOLERANCE_M = 1e-3


@lru_cache(maxsize=8)
def hand_mirror(hand: HandDescription) -> NDArray[np.float64] | None:
    """Reflection of the palm frame (4, 4) that maps the hand's fingers onto each other.

    Tried are the frame's planes through its z axis, on the corners of the fingers' collision
    shapes at one general posture with all fingers closed alike, to 1 mm. The reflected hand has
    the same pre-shape and the same finger angles, some fingers exchanged. None if neither fits.
    Some ms, once per hand.
    """
    joints = np.zeros((1, hand.n_joints))
    for finger in hand.fingers:
        for joint, value in zip(finger.joints, _LINKS_RAD, strict=False):
            joints[0, joint] = value * (SLIDING_LEVER_M if hand.joint_slides[joint] else 1.0)
    hand.preshape.put(joints, hand.preshape.at(_PRESHAPE_SHARE)[None])
    T_palm_link = link_transforms(hand, joints)[0]
    corners = np.concatenate(
        [
            np.asarray(piece.vertices) @ T_palm_link[link, :3, :3].T + T_palm_link[link, :3, 3]
            for link in {i for f in hand.fingers for i in f.links}
            for piece in hand.link_collision[link]
        ]
    )
    tree = cKDTree(corners)
    for axis in range(2):
        reflection = np.eye(4)
        reflection[axis, axis] = -1.0
        if np.max(tree.query(corners @ reflection[:3, :3])[0]) < _TOLERANCE_M:
            return reflection
    return None
