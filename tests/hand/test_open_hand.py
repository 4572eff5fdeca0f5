"""Joints that a URDF counts otherwise than from the open hand: the same hand all the same."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.hand.checks import faults_of
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.drive import joints_from_motors
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.open_hand import JointCount

# As makers of grippers count: 0 where the jaws meet, positive values open them.
OPENS_UP = [
    ('xyz="0 0.0425 0.096"', 'xyz="0 0 0.096"'),
    ('xyz="0 -0.0425 0.096"', 'xyz="0 0 0.096"'),
    ('<axis xyz="0 -1 0"/>', '<axis xyz="0 1 0"/>'),
]
OPEN = [("joints: [left_jaw_joint]", "joints: [left_jaw_joint], open_mm: 42.5")]


@pytest.fixture
def written(tmp_path):
    """A function that writes a shipped hand's files anew with texts replaced."""

    def write(name, in_urdf=(), in_yaml=()):
        hand = load_hand(name)
        folder = tmp_path / "hand"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(hand.yaml_path.parent, folder)
        for path, changes in ((hand.urdf_path, in_urdf), (hand.yaml_path, in_yaml)):
            text = path.read_text()
            for old, new in changes:
                assert old in text
                text = text.replace(old, new)
            (folder / path.name).write_text(text)
        load_hand.cache_clear()
        return load_hand(str(folder / hand.yaml_path.name))

    return write


def test_a_gripper_that_opens_towards_positive_values_is_the_same_gripper(written, rng):
    jaw = load_hand("parallel_jaw")
    hand = written("parallel_jaw", OPENS_UP, OPEN)  # the other jaw by its <mimic>
    motors = np.repeat(rng.uniform(0.0, 0.0425, (5, 1)), 2, axis=1)
    joints = joints_from_motors(hand, np.zeros((5, 0)), motors)
    np.testing.assert_array_equal(joints, motors)
    np.testing.assert_allclose(
        link_transforms(hand, joints), link_transforms(jaw, joints), atol=1e-15
    )
    np.testing.assert_allclose(hand.joint_count.of_urdf(joints), 0.0425 - motors, atol=1e-15)
    np.testing.assert_allclose(hand.desired_contacts.points, jaw.desired_contacts.points)
    assert faults_of(hand) == []
    assert load_hand("parallel_jaw").joint_mimic == hand.joint_mimic


def test_joints_that_close_towards_negative_values_from_an_offset_are_the_same_hand(written, rng):
    """Closed by -0.3 - q, as the distal joints of some makers, and mimicked with an offset."""
    barrett = load_hand()
    urdf = barrett.urdf_path.read_text()
    joint = urdf[urdf.index('<joint name="bh_j13_joint"') :]
    joint = joint[: joint.index("</joint>")]
    upper = float(barrett.joint_upper[barrett.joint_names.index("bh_j13_joint")])
    moved = joint
    for old, new in (
        (
            joint[joint.index("<axis") : joint.index("/>", joint.index("<axis"))],
            '<axis xyz="0 0 -1"',
        ),
        ('lower="0"', f'lower="{-0.3 - upper:.12f}"'),
        (f'upper="{upper:.12g}"', 'upper="-0.3"'),
        ('multiplier="0.333333333333"', 'multiplier="-0.333333333333" offset="-0.3"'),
    ):
        assert old in moved, (old, joint)
        moved = moved.replace(old, new)
    hand = written("barrett_bh280", [(joint, moved)])
    index = hand.joint_names.index("bh_j13_joint")
    assert (hand.joint_count.zero[index], hand.joint_count.sense[index]) == (-0.3, -1.0)
    assert hand.joint_upper[index] == pytest.approx(upper, abs=1e-9)
    joints = rng.uniform(hand.joint_lower, hand.joint_upper, (5, hand.n_joints))
    link = hand.link_names.index("bh_finger_1_distal_link")
    ours, theirs = (link_transforms(h, joints)[:, link] for h in (hand, barrett))
    # its frame is the maker's, turned by -0.3 about its axis when the hand is open
    c, s = np.cos(0.3), np.sin(0.3)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(ours[:, :3, :3], theirs[:, :3, :3] @ turn, atol=1e-9)
    np.testing.assert_allclose(ours[:, :3, 3], theirs[:, :3, 3], atol=1e-12)


def test_counts_are_inverse_of_each_other(rng):
    count = JointCount(rng.normal(size=4), np.array([1.0, -1.0, -1.0, 1.0]))
    joints = rng.normal(size=(3, 4))
    np.testing.assert_allclose(count.of_planner(count.of_urdf(joints)), joints, atol=1e-15)


def test_a_joint_that_could_go_back_closes_from_the_open_hand(written):
    change = [('lower="0" upper="0.0425"', 'lower="-0.02" upper="0.0425"')]
    hand = written("parallel_jaw", change)
    np.testing.assert_array_equal(hand.joint_lower, [0.0, 0.0])
    np.testing.assert_array_equal(hand.joint_back, [-0.02, -0.02])
    assert faults_of(hand) == []


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("open_deg: 3", "'L' slides; give 'open_mm'"),
        ("open_mm: [1, 2]", "one for all of its 1 joints"),
        ("closes_towards: inwards", "give 'lower' or 'upper'"),
        ("closes_towards: lower", "goes from -0.0425 to 0, counted from the open hand"),
        ("open_mm: 50", "goes from 0.0075 to 0.05.*taken as 0.05: give the finger 'open_deg'"),
    ],
)
def test_what_does_not_fit_the_joints_is_refused(written, given, said):
    with pytest.raises(RequestError, match=said):
        written(
            "parallel_jaw", (), [("joints: [left_jaw_joint]", f"joints: [left_jaw_joint], {given}")]
        )


def test_an_open_hand_that_contradicts_the_mimic_is_refused(written):
    follows = '<mimic joint="bh_j12_joint" multiplier="0.333333333333"'
    joints = "joints: [bh_j12_joint, bh_j13_joint]"
    with pytest.raises(RequestError, match=r"open hand has it 0\.1 from"):
        written(
            "barrett_bh280",
            [(follows, f'{follows} offset="0.1"')],
            [(joints, f"{joints}, open_deg: 0")],
        )


def test_a_limit_that_was_rounded_is_meant(written):
    hand = written("parallel_jaw", OPENS_UP, [(OPEN[0][0], OPEN[0][1].replace("42.5", "42.49"))])
    np.testing.assert_array_equal(hand.joint_count.zero, [0.0425, 0.0425])


def test_messages_of_joints_leave_as_the_urdf_counts_them(written):
    from gpis_grasp_planner.cli.hand import facts_of

    hand = written("parallel_jaw", OPENS_UP, OPEN)
    [left, right] = facts_of(hand)["joints"]
    for joint in (left, right):
        assert (joint["lower"], joint["upper"], joint["open"]) == (0.0, 0.0425, 0.0425)
