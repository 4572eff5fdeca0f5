"""The ball of the hand's reach holds every posture."""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.reach import open_span, reach_radius


def test_no_posture_has_two_points_farther_apart_than_the_ball_is_wide() -> None:
    hand, rng = load_hand(), np.random.default_rng(3)
    q = rng.uniform(hand.joint_lower, hand.joint_upper, (400, hand.n_joints))
    ends = rng.random((400, hand.n_joints))
    q = np.where(ends < 0.2, hand.joint_lower, np.where(ends > 0.8, hand.joint_upper, q))
    q[0] = 0.0
    T = link_transforms(hand, q)
    points = np.concatenate(
        [
            np.einsum("bij,vj->bvi", T[:, link, :3, :3], piece.vertices) + T[:, None, link, :3, 3]
            for link in range(hand.n_links)
            for piece in hand.link_collision[link]
        ],
        axis=1,
    )
    wide = max(np.linalg.norm(p[:, None] - p[None], axis=2).max() for p in points[:, ::7])
    assert wide <= 2.0 * reach_radius(hand)
    extent = (points[0].max(axis=0) - points[0].min(axis=0)).max()
    assert open_span(hand) <= extent + 1e-12
    assert 2.0 * reach_radius(hand) < 2.0 * open_span(hand), "the bound is of no use"
