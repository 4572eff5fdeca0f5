"""The parallel-jaw gripper: what its files say, and what a description must not say."""

import shutil

import numpy as np
import pytest

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.hand.checks import faults_of, fingertip_gaps
from gpis_grasp_planner.hand.description import available_hands, load_hand
from gpis_grasp_planner.hand.drive import joints_from_motors, motors_from_joints, reachable
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.link_mesh import solid_properties
from gpis_grasp_planner.hand.mirror import hand_mirror
from gpis_grasp_planner.hand.reach import open_span, reach_radius

STROKE = 0.085


@pytest.fixture
def jaw():
    return load_hand("parallel_jaw")


@pytest.fixture
def copied(jaw, tmp_path):
    """A function that writes the hand's files anew with texts replaced."""

    def write(file: str, old: str, new: str) -> str:
        for path in (jaw.yaml_path, jaw.urdf_path):
            shutil.copy(path, tmp_path / path.name)
        path = tmp_path / file
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))
        return str(tmp_path / "parallel_jaw.yaml")

    return write


def test_pads_are_the_stroke_less_both_ways_apart(jaw, rng):
    closed = rng.uniform(0.0, 0.0425, 20)
    joints = joints_from_motors(jaw, np.zeros((20, 0)), np.stack([closed, closed], axis=1))
    np.testing.assert_array_equal(joints, np.stack([closed, closed], axis=1))
    T = link_transforms(jaw, joints)
    left, right = (T[:, finger.links[0]] for finger in jaw.fingers)
    np.testing.assert_allclose(left[:, 1, 3] - right[:, 1, 3], STROKE - 2.0 * closed, atol=1e-15)
    # pads face each other, whatever the opening: their outward normal is -y of the jaw's frame
    np.testing.assert_allclose(left[:, :3, 1], np.tile([0.0, 1.0, 0.0], (20, 1)), atol=1e-12)
    np.testing.assert_allclose(right[:, :3, 1], np.tile([0.0, -1.0, 0.0], (20, 1)), atol=1e-12)
    share = closed / 0.0425
    np.testing.assert_allclose(fingertip_gaps(jaw, share), STROKE - 2.0 * closed, atol=1e-9)


def test_motors_are_the_jaws_ways_and_both_have_the_same(jaw):
    joints = np.array([[0.01, 0.01], [0.01, 0.02]])
    spread, motors = motors_from_joints(jaw, joints)
    assert spread.shape == (len(joints), 0)
    np.testing.assert_array_equal(motors, joints)
    np.testing.assert_array_equal(reachable(jaw, joints), [True, False])


def test_boxes_are_closed_with_their_faces_outwards(jaw):
    volumes = [solid_properties(piece)[0] for pieces in jaw.link_collision for piece in pieces]
    assert volumes[0] == pytest.approx(0.076 * 0.076 * 0.062, rel=1e-12)
    assert volumes[2] == pytest.approx(0.022 * 0.012 * 0.062, rel=1e-12)
    assert all(len(pieces) == 2 for pieces in jaw.link_collision)


def test_symmetry_reach_and_span(jaw):
    np.testing.assert_array_equal(hand_mirror(jaw), np.diag([-1.0, 1.0, 1.0, 1.0]))
    assert open_span(jaw) == pytest.approx(0.158, abs=1e-12)  # flange to fingertips
    # the farthest corner from the middle of the hand's axis, and a little more
    assert 0.093 < reach_radius(jaw) < 0.099


def test_no_fault_is_found(jaw):
    assert faults_of(jaw) == []
    assert faults_of(load_hand()) == []
    assert "parallel_jaw" in available_hands()


def test_a_hand_of_a_file_is_the_same_hand(jaw, copied):
    path = copied("parallel_jaw.yaml", "name: parallel_jaw", "name: mine")
    hand = load_hand(path)
    assert hand.name == path
    assert (load_hand().identity, jaw.identity) == ("barrett_bh280", "parallel_jaw")
    before = hand.identity
    assert before.startswith(path + "#")
    hand.urdf_path.write_text(hand.urdf_path.read_text() + "<!-- -->")
    assert hand.identity == before  # it is the hand that was read
    load_hand.cache_clear()
    assert load_hand(path).identity != before
    assert hand.joint_names == jaw.joint_names
    np.testing.assert_array_equal(hand.joint_upper, jaw.joint_upper)


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        ("yaml", "joints: [left_jaw_joint]", "joints: [thumb]", "'thumb'"),
        ("yaml", "joints: [left_jaw_joint]", "joints: []", "0 closing joints"),
        ("yaml", "fingers:", "digits:", "'fingers' is missing"),
        ("yaml", "motor_upper_mm: [42.5, 42.5]", "motor_upper_mm: [42.5]", "give 2"),
        ("urdf", '<axis xyz="0 -1 0"/>', '<axis xyz="1 0 0"/>', ""),
        ("urdf", 'type="prismatic"', 'type="revolute"', "slide towards each other"),
        ("urdf", 'type="prismatic"', 'type="planar"', "'planar'"),
        ("urdf", 'lower="0"', 'lower="0.01"', "goes from 0.01 to .* give the finger .open_deg."),
        ("urdf", "<box size=", "<capsule radius=", "shape that is 'capsule'"),
    ],
)
def test_what_contradicts_itself_is_refused(copied, file, old, new, said):
    path = copied(f"parallel_jaw.{file}", old, new)
    if not said:  # both jaws to the same side: read, and found by the check
        assert any("come no nearer" in fault for fault in faults_of(load_hand(path)))
        return
    with pytest.raises(RequestError, match=said):
        load_hand(path)


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        ("yaml", "point_mm: [0.0, 0.0, 24.0]", "point_mm: [0.0, 9.0, 24.0]", "mm from its surface"),
        ("urdf", 'mass value="0.09"', 'mass value="0"', "more than 0"),
        ("urdf", "0.022 0.012 0.062", "22 12 62", "URDF lengths are metres"),
    ],
)
def test_what_makes_bad_plans_is_told(copied, file, old, new, said):
    faults = faults_of(load_hand(copied(f"parallel_jaw.{file}", old, new)))
    assert any(said in fault for fault in faults)


def test_no_such_file_or_name(tmp_path):
    with pytest.raises(RequestError, match="Cannot read the hand"):
        load_hand(str(tmp_path / "none.yaml"))
    with pytest.raises(RequestError, match="parallel_jaw"):
        load_hand("claw")
