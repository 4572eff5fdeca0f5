"""The hand's grips: each is a posture of the hand, walked again joint by joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gpis_grasp_planner.hand.description import DesiredContacts, load_hand
from gpis_grasp_planner.hand.drive import reachable
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.search.contacts.grips import pinches, triads, triangle_sides

SPREAD_MAX = np.pi


@pytest.fixture(scope="module")
def hand():
    return load_hand()


@pytest.fixture(scope="module")
def places_of(hand, oracle):
    """Desired contacts with their normals (n, 6) of a posture, in the palm frame."""

    def places(joints):
        T = []
        for link, parent in enumerate(hand.link_parent):
            here = np.eye(4) if parent < 0 else T[parent] @ hand.T_parent_joint[link]
            joint = hand.link_joint[link]
            if joint >= 0:
                turn = np.eye(4)
                turn[:3, :3] = oracle.rotation_about(hand.joint_axis[link], joints[joint])
                here = here @ turn
            T.append(here)
        wanted = hand.desired_contacts
        return np.array(
            [
                [*(T[link][:3, :3] @ p + T[link][:3, 3]), *(T[link][:3, :3] @ n)]
                for link, p, n in zip(wanted.links, wanted.points, wanted.normals, strict=True)
            ]
        )

    return places


def test_a_pinch_is_a_posture_with_its_places(hand, places_of, rng):
    table = pinches(hand, SPREAD_MAX)
    assert len(table.width) > 1000
    for row in rng.choice(len(table.width), 150, replace=False):
        there = places_of(table.joints[row])
        used = table.used[row]
        own = np.hstack([table.points[row], table.normals[row]])[used]
        for place in own:
            if np.isclose(place[:3], table.points[row][0]).all() and _is_palm(hand, place):
                continue
            assert np.abs(there - place).max(axis=1).min() < 1e-9
        of_shape = table.preshape[row] @ hand.preshape.gain
        assert_allclose(table.joints[row][hand.preshape.joints], of_shape)


def _is_palm(hand, place):
    """Whether a place is the mean of the palm's."""
    on_palm = hand.desired_contacts.links == hand.link_names.index(hand.palm_link)
    return np.allclose(place[:3], hand.desired_contacts.points[on_palm].mean(axis=0))


def test_the_sides_of_a_pinch_face_each_other(hand):
    table = pinches(hand, SPREAD_MAX)
    assert np.all(np.diff(table.width) >= 0.0)
    assert_allclose(np.linalg.norm(table.axis, axis=1), 1.0)
    first = table.middle - 0.5 * table.width[:, None] * table.axis
    # The first side is one finger or the palm: its place is the first.
    single = np.linalg.norm(table.points[:, 0] - first, axis=1)
    assert single.max() < 1e-9
    assert np.einsum("ij,ij->i", table.normals[:, 0], table.axis).min() > np.cos(np.deg2rad(35.1))
    last = table.middle + 0.5 * table.width[:, None] * table.axis
    rest = table.used.copy()
    rest[:, 0] = False
    mean = np.einsum("nsi,ns->ni", table.points, rest) / rest.sum(axis=1)[:, None]
    assert_allclose(mean, last, atol=1e-9)


def test_pinches_are_within_the_hands_travel(hand):
    for table in (pinches(hand, SPREAD_MAX), triads(hand, SPREAD_MAX)):
        assert reachable(hand, table.joints).all()
        assert table.preshape.max() <= SPREAD_MAX
    narrow = pinches(hand, 0.5)
    assert narrow.preshape.max() <= 0.5


def test_a_triad_has_its_fingers_places(hand, places_of, rng):
    table = triads(hand, SPREAD_MAX)
    for row in rng.choice(len(table.preshape), 100, replace=False):
        there = places_of(table.joints[row])
        for place in np.hstack([table.points[row], table.normals[row]]):
            assert np.abs(there - place).max(axis=1).min() < 1e-9


def test_a_finger_with_one_place_is_in_the_triads_by_it():
    barrett = load_hand()
    wanted, outermost = barrett.desired_contacts, barrett.fingers[2].distal_link
    others = ~np.isin(wanted.links, barrett.fingers[2].links)
    kept = others | (np.arange(len(others)) == np.flatnonzero(wanted.links == outermost)[-1])
    few = DesiredContacts(wanted.links[kept], wanted.points[kept], wanted.normals[kept])
    table = triads(replace(barrett, desired_contacts=few), 60.0)
    T = link_transforms(barrett, table.joints)[:, outermost]
    [point] = few.points[few.links == outermost]
    expected = (T[:, :3, :3] @ point) + T[:, :3, 3]
    assert_allclose(table.points[:, 2], expected, atol=1e-9)


def test_a_triad_is_found_by_its_sides(hand, rng):
    table = triads(hand, SPREAD_MAX)
    rows = rng.choice(len(table.preshape), 50, replace=False)
    distance, _ = table.tree.query(triangle_sides(table.points[rows]))
    assert distance.max() < 1e-12
    a, b, c = table.points[rows[0]]
    expected = [np.linalg.norm(a - b), np.linalg.norm(b - c), np.linalg.norm(c - a)]
    assert_allclose(triangle_sides(table.points[rows[:1]])[0], expected)


def test_a_gripper_pinches_with_both_jaws_alike():
    jaw = load_hand("parallel_jaw")
    table = pinches(jaw, 0.0)
    assert triads(jaw, 0.0) is None
    assert table.preshape.shape == (len(table.width), 0)
    assert reachable(jaw, table.joints).all()
    across = np.abs(table.axis[:, 1]) > 1.0 - 1e-9
    assert_allclose(table.width[across], 0.085 - 2.0 * table.joints[across, 0], atol=1e-12)
    assert_allclose(table.middle[:, :2], 0.0, atol=1e-12)
