"""The four-finger hand: sixteen joints, a spread that moves four of them by their own gains."""

import shutil

import numpy as np
import pytest
from hand_models import assert_files_are_as_written

from gpis_grasp_planner.hand.checks import faults_of
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.drive import joints_from_motors, motors_from_joints, reachable
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.mirror import hand_mirror


@pytest.fixture
def hand():
    return load_hand("four_finger_16")


def test_sixteen_joints_and_no_fault(hand):
    assert hand.n_joints == 16
    assert len(hand.fingers) == 4
    assert hand.drive.independent
    assert hand.drive.self_locking
    assert faults_of(hand) == []
    assert hand_mirror(hand) is None  # the thumb turns to one side


def test_the_shipped_files_are_what_the_generator_writes(hand, tmp_path):
    assert_files_are_as_written(hand, tmp_path, 6)


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        (
            "yaml",
            "thumb_base_joint: 1}",
            "thumb_base_joint: 1.2}",
            "'thumb_base_joint' from 0.0000 to 1.0472",
        ),
        (
            "yaml",
            "[95, 95, 95, 95]",
            "[95, 95, 80, 95]",
            "'R' of finger 'R' ends at 1.3963",
        ),
        ("urdf", 'xyz="0.042 -0.038 0.034"', 'xyz="0.042 -0.018 0.034"', "overlap each other"),
    ],
)
def test_what_makes_bad_plans_is_told(hand, tmp_path, file, old, new, said):
    shutil.copytree(hand.urdf_path.parent, tmp_path, dirs_exist_ok=True)
    path = tmp_path / f"four_finger_16.{file}"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    faults = faults_of(load_hand(str(tmp_path / "four_finger_16.yaml")))
    assert any(said in fault for fault in faults), faults


def test_the_spread_fans_the_fingers_and_turns_the_thumb(hand):
    joints = joints_from_motors(hand, np.radians([50.0]), np.zeros((1, 4)))
    bases = hand.preshape.joints
    np.testing.assert_allclose(np.degrees(joints[0, bases]), (-20, 0, 20, 50), atol=1e-9)
    T = link_transforms(hand, joints)[0]
    points_to = [T[finger.knuckle_link, :2, 0] for finger in hand.fingers]
    wanted = np.radians([-20.0, 0.0, 20.0, 230.0])
    np.testing.assert_allclose(points_to, np.c_[np.cos(wanted), np.sin(wanted)], atol=1e-9)


def test_spread_and_motors_are_read_back(hand, rng):
    n = 200
    spread = rng.uniform(0.0, hand.preshape.upper, (n, 1))
    upper = hand.of_fingers(hand.joint_upper)
    held = np.where(rng.random((n, 4, 2)) < 0.5, rng.uniform(0.0, upper[:, :2], (n, 4, 2)), np.inf)
    # no farther than where the last joint ends: all row ends lie at the same share of the limits
    motors = rng.uniform(0.0, 0.3, (n, 4))
    joints = joints_from_motors(hand, spread, motors, held)
    assert (hand.of_fingers(joints)[..., 2] < upper[:, 2]).all()
    back = motors_from_joints(hand, joints)
    np.testing.assert_allclose(back[0], spread, atol=1e-12)
    np.testing.assert_allclose(back[1], motors, atol=1e-12)
    assert reachable(hand, joints).all()


def test_a_hand_whose_bases_disagree_is_out_of_reach(hand):
    good = joints_from_motors(hand, [0.4], np.full((1, 4), 0.5))[0]
    fan, middle = good.copy(), good.copy()
    fan[hand.preshape.joints[0]] += 0.05
    middle[hand.preshape.joints[1]] += 0.05
    np.testing.assert_array_equal(
        reachable(hand, np.stack([good, fan, middle])), [True, False, False]
    )
    assert hand.preshape.of(good[None])[0, 0] == pytest.approx(0.4)


def test_free_fingers_keep_their_ratios_and_those_outwards_of_a_held_link_go_on(hand):
    joints = joints_from_motors(hand, [0.0], np.full((1, 4), 1.0))[0]
    np.testing.assert_allclose(hand.of_fingers(joints), np.tile([1.0, 0.9, 0.8], (4, 1)))
    held = np.full((1, 4, 2), np.inf)
    held[0, 0, 0] = 0.5
    joints = joints_from_motors(hand, [0.0], np.full((1, 4), 0.6), held)[0]
    # 0.1 of the motor is 0.27 of joints: 0.9 to 0.8 of middle and distal
    np.testing.assert_allclose(
        joints[list(hand.fingers[0].joints)],
        (0.5, 0.45 + 0.27 * 0.9 / 1.7, 0.4 + 0.27 * 0.8 / 1.7),
        atol=1e-9,
    )
