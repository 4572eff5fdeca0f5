"""Fingers of three links close by their table, judged by independent distances."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.grasp.evaluator import AttemptStatus
from gpis_grasp_planner.hand.drive import joints_from_motors, motors_from_joints, reachable
from gpis_grasp_planner.scene.bullet_evaluator import BulletEvaluator

HANDS = ["three_finger_adaptive", "four_finger_16"]
TOLERANCE = 2e-6
PARTS = ["mug", "box", "cylinder", "rod", "bishop"]


def row_ways(q: np.ndarray, table: np.ndarray) -> np.ndarray:
    """How far each row of the closing table was gone to joints (D,), by forward substitution."""
    return np.linalg.solve(table.T, q)


@pytest.mark.parametrize("hand", HANDS)
@pytest.mark.parametrize("name", PARTS)
def test_a_joint_goes_on_only_where_those_before_it_are_held(scene, name, hand, rng):
    s = scene(name, hand)
    stops = s.hand.drive.advances_at_stop
    T, spread = s.cleared(60, rng)
    a = s.evaluator.attempt(T, spread)
    gap, held_by_part, held_by_stop = s.settings.closing_gap_m, 0, 0
    rows = np.flatnonzero(a.status == AttemptStatus.GRASPED)
    assert reachable(s.hand, a.joints[rows]).all()
    for row in rows:
        gaps = s.gaps(a.T_object_palm[row], a.joints[row])
        assert gaps.min() > -TOLERANCE
        for finger in s.hand.fingers:
            q = a.joints[row][list(finger.joints)]
            upper = s.hand.joint_upper[list(finger.joints)]
            near = gaps[list(finger.links)] <= 4.0 * gap + TOLERANCE
            moved = np.flatnonzero(row_ways(q, s.hand.fingers[0].closing_ratio) > 1e-9)
            last = int(moved[-1]) if len(moved) else 0
            for k in range(last):
                at_stop = stops and q[k] >= upper[k] - 1e-9
                # held by itself, or with a link outwards of it
                assert at_stop or near[k:last].any()
                held_by_part += not at_stop
                held_by_stop += at_stop
            at_end = q[last] >= upper[last] - 1e-9
            if near.any():
                assert near[last:].any() or at_end
    print(name, len(rows), "grasps,", held_by_part, "held by the part,", held_by_stop, "by stops")
    assert len(rows) > 3
    assert held_by_part + held_by_stop > 3


@pytest.mark.parametrize("hand", HANDS)
def test_without_an_object_all_links_come_to_their_ends_or_to_the_hand(scene, hand):
    s = scene("marble", hand)
    T = np.tile(transform(np.eye(3), [0.0, 0.0, 5.0]), (5, 1, 1))
    spread = np.linspace(s.hand.preshape.lower, s.hand.preshape.upper, 5)
    a = s.evaluator.attempt(T, spread)
    assert (a.status == AttemptStatus.TOO_FEW_CONTACTS).all()
    # on the way of the drive, whatever was opened again to let others pass
    _, motors = motors_from_joints(s.hand, a.joints)
    np.testing.assert_allclose(joints_from_motors(s.hand, spread, motors), a.joints, atol=1e-9)
    assert (motors > 0.5).all()
    for q in a.joints:
        assert s.gap_between_fingers(q) > 1e-4 - TOLERANCE


@pytest.mark.parametrize("name", ["box", "bishop"])
def test_closing_from_beyond_a_stop_ends_in_the_same_hand(scene, name, rng):
    """The way of the drive has no memory before the first contact."""
    s = scene(name, "three_finger_adaptive")
    T, spread = s.cleared(60, rng)
    a = s.evaluator.attempt(T, spread)
    rows = np.flatnonzero(a.status == AttemptStatus.GRASPED)
    q = s.hand.of_fingers(a.joints[rows])
    upper = s.hand.of_fingers(s.hand.joint_upper)
    at_stop = q[..., 0] >= upper[:, 0] - 1e-9
    # a little before the first contact where that is in the first or the second row
    motors = np.where(at_stop, upper[:, 0] + 0.5 * q[..., 1], np.maximum(q[..., 0] - 0.1, 0.0))
    start = joints_from_motors(s.hand, spread[rows], motors)
    again = s.evaluator.attempt_from(a.T_object_palm[rows], start)
    same = again.status == AttemptStatus.GRASPED
    print(name, same.sum(), "of", len(rows), "from", at_stop.sum(), "fingers beyond a stop")
    assert same.mean() > 0.8
    apart = np.abs(again.joints - a.joints[rows])[same].max(axis=1)
    assert np.median(apart) < 1e-3


@pytest.mark.parametrize("hand", HANDS)
@pytest.mark.parametrize("name", ["cylinder", "mug"])
def test_bullet_closes_the_fingers_alike(scene, name, hand, rng):
    s = scene(name, hand)
    T, spread = s.cleared(10, rng)
    a = s.evaluator.attempt(T, spread)
    with BulletEvaluator(s.hand, s.part, s.evaluator.friction, s.settings) as bullet:
        b = bullet.attempt(T, spread)
    both = (a.status == AttemptStatus.GRASPED) & (b.status == AttemptStatus.GRASPED)
    assert both.sum() >= 2
    apart = np.abs(a.joints - b.joints)[both].max(axis=1)
    print(name, both.sum(), "of", len(T), "largest difference", apart)
    assert np.median(apart) < 5e-3
