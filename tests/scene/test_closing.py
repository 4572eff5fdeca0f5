"""AutoGrasp: never in penetration, coupling and breakaway, limits, symmetry."""

import numpy as np
import pytest

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.grasp.evaluator import AttemptStatus

TOLERANCE = 2e-6  # of the judge


def closed(s, n, rng):
    T, spread = s.cleared(n, rng)
    return s.evaluator.attempt(T, spread)


PARTS = ["mug", "bracket", "spur_gear", "ball", "box", "cylinder", "plate", "rod", "marble"]


@pytest.mark.parametrize("name", PARTS)
def test_no_link_of_a_closed_hand_penetrates_and_no_finger_meets_another(scene, name, rng):
    s = scene(name)
    a = closed(s, 40, rng)
    checked = np.flatnonzero(np.isin(a.status, (AttemptStatus.GRASPED, AttemptStatus.NO_WAY_BACK)))
    print(name, np.bincount(a.status, minlength=5))
    assert len(checked) > (2 if name == "marble" else 8)
    for row in checked:
        assert s.gaps(a.T_object_palm[row], a.joints[row]).min() > -TOLERANCE
        assert s.gap_between_fingers(a.joints[row]) > -TOLERANCE


@pytest.mark.parametrize("name", ["mug", "box"])
def test_self_collision_means_that_links_do_meet(scene, name, rng):
    s = scene(name)
    a = closed(s, 120, rng)
    for row in np.flatnonzero(a.status == AttemptStatus.SELF_COLLISION)[:20]:
        assert s.gap_between_fingers(a.joints[row]) < 1e-5 + TOLERANCE


@pytest.mark.parametrize("name", ["mug", "box", "rod", "bishop"])
def test_coupling_before_and_after_the_breakaway(scene, name, rng):
    s = scene(name)
    a = closed(s, 60, rng)
    gap, freed = s.settings.closing_gap_m, 0
    for row in np.flatnonzero(a.status == AttemptStatus.GRASPED):
        q = a.joints[row]
        assert (q >= s.hand.joint_lower).all()
        assert (q <= s.hand.joint_upper + 1e-12).all()
        gaps = s.gaps(a.T_object_palm[row], q)
        for finger in s.hand.fingers:
            inner, distal = q[finger.inner_joint], q[finger.distal_joint]
            coupled = min(inner / 3.0, s.hand.joint_upper[finger.distal_joint])
            assert distal >= coupled - 1e-12
            inner_touches = gaps[finger.inner_link] <= 2.0 * gap + TOLERANCE
            distal_touches = gaps[finger.distal_link] <= 4.0 * gap + TOLERANCE
            if distal > coupled + 1e-9:
                # only an inner link that was stopped lets the distal link go on
                freed += 1
                assert inner_touches
                at_end = distal >= s.hand.joint_upper[finger.distal_joint] - 1e-9
                assert distal_touches or at_end
    assert freed > 5


def test_spread_is_kept_and_equal_on_both_fingers(scene, rng):
    a = closed(scene("cylinder"), 30, rng)
    np.testing.assert_array_equal(a.joints[:, 0], a.preshape[:, 0])
    np.testing.assert_array_equal(a.joints[:, 1], a.preshape[:, 0])


def test_fingers_without_an_object_close_to_their_end_but_not_into_the_hand(scene):
    s = scene("marble")
    T = np.tile(transform(np.eye(3), [0.0, 0.0, 5.0]), (9, 1, 1))
    spread = np.linspace(0.0, np.pi, 9)[:, None]
    a = s.evaluator.attempt(T, spread)
    assert (a.status == AttemptStatus.TOO_FEW_CONTACTS).all()
    assert (a.n_contacts == 0).all()
    for q in a.joints:
        assert s.gap_between_fingers(q) > 0.0
        for finger in s.hand.fingers:
            opened = q.copy()
            ends = q[finger.inner_joint] >= s.hand.joint_upper[finger.inner_joint] - 1e-9
            if not ends:
                # a finger that stops earlier does so because a little farther it would meet
                opened[finger.inner_joint] += 0.06
                opened[finger.distal_joint] = min(
                    opened[finger.inner_joint] / 3.0, s.hand.joint_upper[finger.distal_joint]
                )
                assert s.gap_between_fingers(opened) < 3e-4


def test_symmetric_grasp_closes_symmetrically(scene):
    """A cylinder across the palm's middle plane: F1 and F2 are mirror images of each other."""
    s = scene("cylinder")
    R = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # palm x along its axis
    for height in (0.105, 0.12, 0.135):
        T = transform(R, -height * R[:, 2])[None]
        a = s.evaluator.attempt(T, np.zeros((1, 1)))
        assert a.status[0] == AttemptStatus.GRASPED
        first, second = s.hand.fingers[0], s.hand.fingers[1]
        q = a.joints[0]
        assert q[first.inner_joint] == pytest.approx(q[second.inner_joint], abs=0.003)
        assert q[first.distal_joint] == pytest.approx(q[second.distal_joint], abs=0.003)
        assert 0.2 < q[first.inner_joint] < 2.4


def test_a_larger_ball_stops_the_fingers_earlier(scene):
    T = transform(np.eye(3), [0.0, 0.0, -0.13])[None]
    small, large = scene("marble"), scene("ball")
    a, b = (s.evaluator.attempt(T, np.zeros((1, 1))).joints[0] for s in (small, large))
    joint = large.hand.fingers[2].inner_joint
    assert b[joint] < a[joint]
