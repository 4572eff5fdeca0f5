"""The hand's plane of symmetry, by forward kinematics walked the other way round."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose
from scipy.spatial import cKDTree

from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.mirror import hand_mirror


def finger_corners(hand, joints):
    """Corners (n, 3) of each finger's inner and distal pieces: list over the fingers."""
    T = link_transforms(hand, joints[None])[0]
    return [
        np.concatenate(
            [
                piece.vertices @ T[link, :3, :3].T + T[link, :3, 3]
                for link in (finger.inner_link, finger.distal_link)
                for piece in hand.link_collision[link]
            ]
        )
        for finger in hand.fingers
    ]


def test_the_barrett_hand_is_its_own_image_with_two_fingers_exchanged(rng):
    hand = load_hand()
    mirror = hand_mirror(hand)
    assert_allclose(mirror, np.diag([-1.0, 1.0, 1.0, 1.0]), atol=0.0)
    spread, alone = hand.fingers[:2], hand.fingers[2:]
    assert (len(spread), len(alone)) == (2, 1)
    order = [hand.fingers.index(f) for f in (spread[1], spread[0], alone[0])]
    for _ in range(5):
        angles = rng.uniform([0.0, 0.0], [2.0, 0.7], (3, 2))
        opening = rng.uniform(0.0, np.pi)
        here, image = np.zeros(hand.n_joints), np.zeros(hand.n_joints)
        for k, finger in enumerate((*spread, *alone)):
            for joints, own in ((here, angles[k]), (image, angles[[1, 0, 2][k]])):
                joints[[finger.inner_joint, finger.distal_joint]] = own
                if k < 2:
                    joints[hand.preshape.joints[k]] = opening
        reflected = [corners @ mirror[:3, :3] for corners in finger_corners(hand, here)]
        exchanged = finger_corners(hand, image)
        pairs = zip((*spread, *alone), order, strict=True)
        for finger, other in pairs:
            tree = cKDTree(exchanged[other])
            distance, _ = tree.query(reflected[hand.fingers.index(finger)])
            assert distance.max() < 1e-9


def test_a_hand_with_one_odd_finger_has_no_plane():
    hand = load_hand()
    link = hand.fingers[0].distal_link
    pieces = list(hand.link_collision)
    pieces[link] = tuple(
        replace(piece, vertices=piece.vertices * np.array([1.2, 1.0, 1.0]))
        for piece in pieces[link]
    )
    assert hand_mirror(replace(hand, link_collision=tuple(pieces))) is None
