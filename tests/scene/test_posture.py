"""Compiled kinematics and distances against the hand's own kinematics and another library."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.gjk import polytope_distance
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.scene.arrays import hand_arrays
from gpis_grasp_planner.scene.posture import (
    boxes_apart,
    coarse_gap,
    exact_gap,
    far_from_field,
    finger_meets_hand,
    overlaps,
    place_hand,
    surely_free,
)


def random_joints(hand, rng):
    return rng.uniform(hand.joint_lower, hand.joint_upper)


def placed(hand, joints, T):
    R, t = np.empty((hand.n_links, 3, 3)), np.empty((hand.n_links, 3))
    place_hand(hand_arrays_of(hand), joints, T, R, t)
    return R, t


_ARRAYS = {}


def hand_arrays_of(hand):
    return _ARRAYS.setdefault(id(hand), hand_arrays(hand))


def poses_near(s, n, rng):
    """Poses at which some links overlap the object, some are near and some are far."""
    R = Rotation.random(n, rng=rng).as_matrix()
    return transform(R, rng.normal(size=(n, 3)) * 0.05 - 0.09 * R[:, :, 2])


def test_place_hand_is_the_hands_forward_kinematics(scene, rng):
    s = scene("box")
    for T in poses_near(s, 30, rng):
        q = random_joints(s.hand, rng)
        R, t = placed(s.hand, q, T)
        expected = T @ link_transforms(s.hand, q[None])[0]
        np.testing.assert_allclose(R, expected[:, :3, :3], atol=1e-13)
        np.testing.assert_allclose(t, expected[:, :3, 3], atol=1e-14)


@pytest.mark.parametrize("name", ["mug", "rod"])
def test_exact_gap_is_the_distance_up_to_its_limit(scene, name, rng):
    s = scene(name)
    hand, obj, work = s.evaluator._hand, s.evaluator._object, np.empty((512, 3))
    kinds = np.zeros(3, dtype=int)
    for T in poses_near(s, 40, rng):
        q = random_joints(s.hand, rng)
        R, t = placed(s.hand, q, T)
        for link, expected in enumerate(s.gaps(T, q)):
            for limit in (2e-4, 0.004, 0.03):
                d = exact_gap(hand, obj, link, R, t, limit, work)
                # a link within the solid touches none of its faces: only the field can tell
                assert d == pytest.approx(min(max(expected, 0.0), limit), abs=3e-6)
            assert overlaps(hand, obj, link, R, t, work) == (d == 0.0)
            least = surely_free(hand, obj, link, coarse_gap(hand, obj, link, R, t))
            assert least <= max(expected, 0.0)
            kinds[0 if expected <= 0 else 1 if expected < 0.03 else 2] += 1
    assert kinds.min() > 5


def test_a_link_that_is_passed_over_has_no_probe_inside(scene, rng):
    s = scene("mug")
    hand, obj = s.evaluator._hand, s.evaluator._object
    far = near = 0
    for T in poses_near(s, 60, rng):
        R, t = placed(s.hand, random_joints(s.hand, rng), T)
        for link in range(s.hand.n_links):
            if far_from_field(hand, obj, link, R, t):
                assert coarse_gap(hand, obj, link, R, t) > 0.0
                far += 1
            else:
                near += 1
    assert min(far, near) > 30


def test_boxes_tell_pieces_apart_only_where_they_are(scene, rng):
    s = scene("box")
    hand = s.evaluator._hand
    told = not_told = 0
    for _ in range(20):
        q = random_joints(s.hand, rng)
        R, t = placed(s.hand, q, np.eye(4))
        placed_pieces = []
        for piece, link in enumerate(hand.piece_link):
            corners = hand.piece_vertices[hand.piece_start[piece] : hand.piece_start[piece + 1]]
            placed_pieces.append(np.ascontiguousarray(corners @ R[link].T + t[link]))
        p, other = np.empty(3), np.empty(3)
        for a in range(len(placed_pieces)):
            for b in range(a):
                d = polytope_distance(
                    placed_pieces[a], placed_pieces[b], 1.0, np.zeros(3), p, other
                )
                for limit in (1e-6, 0.01):
                    if boxes_apart(hand, a, b, R, t, limit):
                        assert d > limit
                        told += 1
                    else:
                        not_told += d > limit
    assert told > 4 * not_told


def test_fingers_that_meet_are_found(scene, rng):
    s = scene("box")
    hand, work, other = s.evaluator._hand, np.empty((512, 3)), np.empty((512, 3))
    T = np.eye(4)
    met = 0
    for _ in range(60):
        q = s.joints(rng.uniform(0.0, np.pi, 1))
        for finger in s.hand.fingers:
            q[finger.inner_joint] = rng.uniform(0.8, 2.44)
            q[finger.distal_joint] = min(q[finger.inner_joint] / 3.0, 0.83)
        R, t = placed(s.hand, q, T)
        gap = s.gap_between_fingers(q)
        if abs(gap) < 3e-6:
            continue
        found = [finger_meets_hand(hand, f, R, t, 1e-6, work, other) for f in range(3)]
        assert any(found) == (gap < 0.0)
        met += gap < 0.0
    assert 5 < met < 55
