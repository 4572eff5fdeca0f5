"""Trials start with fingers near the part and clear of it."""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.scene.bullet_world import BulletWorld
from gpis_grasp_planner.verification.start import StartFinder


def test_fingers_start_clear_and_near(bar: Part, hand: HandDescription, firm: Grasp) -> None:
    finder = StartFinder.of(hand, DistanceField.of(bar.mesh))
    joints = finder.start_joints(firm.T_object_palm, firm.pregrasp_joints)
    with BulletWorld(hand, bar.mesh) as world:
        world.place_palm(firm.T_object_palm)
        world.set_joints(joints)
        for finger in hand.fingers:
            gap = min(world.gap(link, 0.02) for link in (finger.inner_link, finger.distal_link))
            assert 0.002 < gap < 0.008
            inner, distal = joints[finger.inner_joint], joints[finger.distal_joint]
            assert abs(distal - inner / 3) < 1e-12
            assert firm.joints[finger.inner_joint] - 0.2 < inner < firm.joints[finger.inner_joint]


def test_a_palm_in_the_part_goes_back_until_free(
    bar: Part, hand: HandDescription, firm: Grasp
) -> None:
    finder = StartFinder.of(hand, DistanceField.of(bar.mesh))
    deep = firm.T_object_palm.copy()
    deep[:3, 3] += 0.006 * deep[:3, 2]
    back = finder.back_until_free(deep, firm.pregrasp_joints, 0.02)
    assert back is not None
    moved = (back[:3, 3] - deep[:3, 3]) @ deep[:3, 2]
    assert -0.0075 < moved < -0.004
    assert np.array_equal(back[:3, :3], deep[:3, :3])
    assert finder.back_until_free(deep, firm.pregrasp_joints, 0.003) is None
    free = finder.back_until_free(firm.T_object_palm, firm.pregrasp_joints, 0.02)
    assert np.array_equal(free, firm.T_object_palm)
