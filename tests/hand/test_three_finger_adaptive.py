"""The three-finger adaptive gripper: links that close one after the other, up to their stops."""

import shutil

import numpy as np
import pytest
from hand_models import assert_files_are_as_written

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.hand.checks import faults_of
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.drive import (
    joints_from_motors,
    motors_from_joints,
    reachable,
    row_ends,
    touch_motors,
)
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.mirror import hand_mirror

STOPS = np.array([75.0, 90.0, 55.0])  # proximal, middle, distal [deg]


@pytest.fixture
def hand():
    return load_hand("three_finger_adaptive")


def finger(hand, motor, held=(np.inf, np.inf)):
    """The first finger's joints [deg] at a motor's angle [deg], inner links held at angles."""
    motors = np.radians([[motor, 0.0, 0.0]])
    stops = np.full((1, 3, 2), np.inf)
    stops[0, 0] = np.radians(held)
    return np.degrees(
        joints_from_motors(hand, [0.0], motors, stops)[0, list(hand.fingers[0].joints)]
    )


@pytest.mark.parametrize(
    ("motor", "joints"),
    [
        (0.0, (0, 0, 0)),
        (60.0, (60, 0, 0)),
        (75.0, (75, 0, 0)),
        (100.0, (75, 25, 0)),
        (165.0, (75, 90, 0)),
        (200.0, (75, 90, 35)),
        (220.0, (75, 90, 55)),
        (400.0, (75, 90, 55)),
    ],
)
def test_free_links_close_one_after_the_other_to_their_stops(hand, motor, joints):
    np.testing.assert_allclose(finger(hand, motor), joints, atol=1e-9)


def test_a_link_that_touches_lets_the_next_go_on_at_once(hand):
    np.testing.assert_allclose(finger(hand, 50.0, (30.0, np.inf)), (30, 20, 0), atol=1e-9)
    np.testing.assert_allclose(finger(hand, 140.0, (30.0, np.inf)), (30, 90, 20), atol=1e-9)
    np.testing.assert_allclose(finger(hand, 60.0, (30.0, 10.0)), (30, 10, 20), atol=1e-9)
    # a middle link that touches while the first still moves holds both
    np.testing.assert_allclose(finger(hand, 60.0, (30.0, 0.0)), (30, 0, 30), atol=1e-9)


def test_motors_and_joints_are_inverse_whatever_is_held(hand, rng):
    n = 300
    held = np.where(
        rng.random((n, 3, 2)) < 0.5, rng.uniform(0.0, np.radians(STOPS[:2]), (n, 3, 2)), np.inf
    )
    most = np.minimum(held, np.radians(STOPS[:2])).sum(axis=-1) + np.radians(STOPS[2])
    motors = rng.uniform(0.0, most)
    spread = rng.uniform(0.0, np.radians(30.0), (n, 1))
    joints = joints_from_motors(hand, spread, motors, held)
    back = motors_from_joints(hand, joints)
    np.testing.assert_allclose(back[0], spread, atol=1e-12)
    np.testing.assert_allclose(back[1], motors, atol=1e-12)
    assert reachable(hand, joints).all()
    # closed again with the joints held where they are, the hand is the same
    again = joints_from_motors(hand, spread, motors, hand.of_fingers(joints)[..., :-1])
    np.testing.assert_allclose(again, joints, atol=1e-12)


def test_where_rows_end_and_where_the_first_contact_was(hand):
    def of(joints):
        q = np.zeros((1, hand.n_joints))
        q[0, list(hand.fingers[0].joints)] = np.radians(joints)
        return np.degrees(row_ends(hand, q)[0, 0]), np.degrees(touch_motors(hand, q)[0, 0])

    ends, touch = of((30.0, 20.0, 10.0))
    np.testing.assert_allclose(ends, (30, 50), atol=1e-9)
    assert touch == pytest.approx(30.0)
    # a joint at its stop is no contact
    assert of((75.0, 20.0, 10.0))[1] == pytest.approx(95.0)
    assert of((75.0, 90.0, 10.0))[1] == pytest.approx(175.0)


def test_open_fingers_and_one_that_stands_straight(hand):
    T = link_transforms(hand, np.zeros((1, hand.n_joints)))[0]
    for each in hand.fingers:
        out = T[each.knuckle_link, :3, 0]
        along = T[each.links[0], :3, 0]
        assert np.degrees(np.arctan2(along @ out, along[2])) == pytest.approx(25.0, abs=1e-6)
    closed = joints_from_motors(hand, [0.0], np.radians([[25.0] * 3]))
    T = link_transforms(hand, closed)[0]
    for each in hand.fingers:
        np.testing.assert_allclose(T[each.links[0], :3, 0], (0, 0, 1), atol=1e-8)
        # pads face the axis of the palm
        assert T[each.links[0], :3, 1] @ T[each.knuckle_link, :3, 0] == pytest.approx(-1.0)


def test_the_shipped_files_are_what_the_generator_writes(hand, tmp_path):
    assert_files_are_as_written(hand, tmp_path, 7)


def test_it_has_no_fault_and_one_plane_of_symmetry(hand):
    assert faults_of(hand) == []
    np.testing.assert_array_equal(hand_mirror(hand), np.diag([-1.0, 1.0, 1.0, 1.0]))
    assert (hand.drive.tip_force_n, hand.drive.holding_force_n) == (25.0, 120.0)
    assert load_hand().drive.tip_force_n is None


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("    - [0, 0, 1]\n", "", r"shape \(2, 3\)"),
        ("- [0, 1, 0]", "- [0.5, 1, 0]", "0 for the joints before"),
        ("- [0, 1, 0]", "- [0, 2, 0]", "1 for joint h"),
        ("- [1, 0, 0]", "- [1, 0, 0.4]", ""),
        ("- [1, 0, 0]", "- [1, 0, 0.8]", "row 1 .* joint 3 would go to 1.0472"),
        ("  closing_rows:", "  rows:", "need 'closing_rows'"),
    ],
)
def test_tables_that_do_not_fit_are_refused(hand, tmp_path, old, new, said):
    shutil.copytree(hand.urdf_path.parent, tmp_path, dirs_exist_ok=True)
    text = hand.yaml_path.read_text()
    assert old in text
    path = tmp_path / "mine.yaml"
    path.write_text(text.replace(old, new))
    if not said:
        load_hand(str(path))
        return
    with pytest.raises(RequestError, match=said):
        load_hand(str(path))
