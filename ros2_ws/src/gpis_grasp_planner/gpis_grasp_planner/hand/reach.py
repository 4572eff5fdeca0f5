"""A ball that holds the whole hand in every posture: the bound on what a grasp can take in."""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np

from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.kinematics import link_transforms

# Postures per joint of a chain, by its number of joints: some thousand in all.
_STEPS = {0: 1, 1: 64, 2: 24, 3: 11, 4: 6}
_FEWEST_STEPS = 5
_HEIGHTS = 11


@lru_cache(maxsize=8)
def reach_radius(hand: HandDescription) -> float:
    """Radius of a ball about a point of the palm's axis that the hand never leaves [m].

    Over a grid of each link's own joints, within their limits and without the couplings between
    them; between the grid's postures a point moves at most by half a step times its lever, which
    is added. An upper bound therefore, and some percent too large. About 0.4 s, once
    a hand and process.
    """
    points, slack = [], 0.0
    for link in range(hand.n_links):
        if not hand.link_collision[link]:
            continue
        vertices = np.concatenate([piece.vertices for piece in hand.link_collision[link]])
        path = _path(hand, link)
        joints = [int(hand.link_joint[k]) for k in path if hand.link_joint[k] >= 0]
        n = _STEPS.get(len(joints), _FEWEST_STEPS)
        axes = [np.linspace(hand.joint_lower[j], hand.joint_upper[j], n) for j in joints]
        q = np.zeros((n ** len(joints), hand.n_joints))
        q[:, joints] = np.array(list(product(*axes)))
        T = link_transforms(hand, q)[:, link]
        points.append((T[:, None, :3, :3] @ vertices[:, :, None])[..., 0] + T[:, None, :3, 3])
        lever, moved = float(np.linalg.norm(vertices, axis=1).max()), 0.0
        for k in reversed(path):
            if (j := int(hand.link_joint[k])) >= 0:
                half = 0.5 * float(hand.joint_upper[j] - hand.joint_lower[j]) / (n - 1)
                if hand.joint_slides[j]:
                    moved += half
                    lever += float(hand.joint_upper[j] - hand.joint_lower[j])
                else:
                    moved += half * lever
            lever += float(np.linalg.norm(hand.T_parent_joint[k][:3, 3]))
        slack = max(slack, moved)
    every = np.concatenate([p.reshape(-1, 3) for p in points])
    heights = np.linspace(every[:, 2].min(), every[:, 2].max(), _HEIGHTS)
    radii = [np.linalg.norm(every - [0.0, 0.0, z], axis=1).max() for z in heights]
    return float(min(radii)) + slack


@lru_cache(maxsize=8)
def open_span(hand: HandDescription) -> float:
    """Largest extent of the hand along an axis of its palm, joints at 0 [m]; its reach is more."""
    T = link_transforms(hand, np.zeros((1, hand.n_joints)))[0]
    points = np.concatenate(
        [
            piece.vertices @ T[link, :3, :3].T + T[link, :3, 3]
            for link in range(hand.n_links)
            for piece in hand.link_collision[link]
        ]
    )
    return float((points.max(axis=0) - points.min(axis=0)).max())


def _path(hand: HandDescription, link: int) -> list[int]:
    """Links from the root to this one."""
    path = [link]
    while (parent := int(hand.link_parent[path[0]])) >= 0:
        path.insert(0, parent)
    return path
