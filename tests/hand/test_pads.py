"""Where a hand is wanted to touch, by its shapes: known sides, and those of the models' files."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.link_mesh import convex_hull
from gpis_grasp_planner.hand.pads import pad_of_palm, pads_of_link

Z = np.array([0.0, 0.0, 1.0])


def box(lower, upper):
    return convex_hull(
        [
            [x, y, z]
            for x in (lower[0], upper[0])
            for y in (lower[1], upper[1])
            for z in (lower[2], upper[2])
        ]
    )


def test_a_link_that_turns_touches_with_the_side_ahead_at_its_middle():
    link = box((0.0, -0.007, -0.009), (0.05, 0.007, 0.009))
    places = pads_of_link([link], Z, slides=False)
    assert len(places) == 2
    for point, normal in places:
        np.testing.assert_allclose(normal, [0.0, 1.0, 0.0], atol=1e-9)
        assert point[1] == pytest.approx(0.007)
        assert abs(point[2]) < 0.003
    assert places[0][0][0] < 0.035 < places[1][0][0] < 0.05
    [(point, normal)] = pads_of_link([box((0, -0.007, -0.005), (0.02, 0.007, 0.005))], -Z, False)
    np.testing.assert_allclose(normal, [0.0, -1.0, 0.0], atol=1e-9)


def test_a_jaw_touches_with_the_side_that_slides_ahead():
    places = pads_of_link(
        [box((-0.01, 0.0, 0.0), (0.01, 0.005, 0.06))], np.array([0, -1.0, 0]), True
    )
    for point, normal in places:
        np.testing.assert_allclose(normal, [0.0, -1.0, 0.0], atol=1e-9)
        assert point[1] == pytest.approx(0.0, abs=1e-9)


def test_a_palm_touches_with_the_middle_of_its_face():
    [(point, normal)] = pad_of_palm([box((-0.04, -0.03, 0.0), (0.06, 0.03, 0.05))])
    np.testing.assert_allclose(normal, Z, atol=1e-9)
    np.testing.assert_allclose(point, [0.01, 0.0, 0.05], atol=0.006)
    assert pad_of_palm([]) == pads_of_link([], Z, False) == []


@pytest.mark.parametrize(
    "name", ["barrett_bh280", "parallel_jaw", "three_finger_adaptive", "four_finger_16"]
)
def test_they_are_on_the_sides_that_the_models_files_name(name):
    hand = load_hand(name)
    wanted = hand.desired_contacts
    for finger in hand.fingers:
        for link, joint in zip(finger.links, finger.joints, strict=True):
            said = wanted.normals[wanted.links == link].mean(axis=0)
            found = pads_of_link(
                hand.link_collision[link], hand.joint_axis[link], bool(hand.joint_slides[joint])
            )
            assert found
            for _, normal in found:
                assert normal @ said > 0.8 * np.linalg.norm(said)
