"""A part on a plane: fingers that come one after the other push it, together they do not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.drive import motors_from_joints
from gpis_grasp_planner.surroundings.pregrasp import arrival_spread_s
from gpis_grasp_planner.verification.protocol import Verifier
from gpis_grasp_planner.verification.settings import VerificationSettings
from gpis_grasp_planner.verification.start import StartFinder
from gpis_grasp_planner.verification.table_closing import closing_motion

FRICTION = 0.4


@pytest.mark.parametrize("engine", ["mujoco", "bullet"])
def test_fingers_that_come_one_after_the_other_push_the_part_along(
    make_box: Callable[..., Part],
    hand: HandDescription,
    palm_face: float,
    grasp_of: Callable[..., Grasp],
    engine: str,
) -> None:
    """A standing box between fingertips; one side comes with the other, or long before it."""
    block = make_box(0.08, 0.05, 0.10)
    pinch = grasp_of(block, np.array([0.0, 0.0, palm_face + 0.07]))
    up = -pinch.T_object_palm[:3, 2]
    point = up * (block.mesh.vertices @ up).min()
    early = pinch.pregrasp_joints.copy()
    finger = hand.fingers[2]
    early[finger.inner_joint] = 0.9 * pinch.joints[finger.inner_joint]
    early[finger.distal_joint] = early[finger.inner_joint] / 3.0
    one_sided = replace(pinch, pregrasp_joints=early)
    assert arrival_spread_s(hand, pinch) < 0.01
    assert arrival_spread_s(hand, one_sided) > 0.4
    with Verifier(block, hand, VerificationSettings(engine=engine), whole_cover=True) as verifier:
        together, apart = (
            closing_motion(verifier, grasp, point, up, FRICTION) for grasp in (pinch, one_sided)
        )
    print(engine, together, apart)
    assert together is not None
    assert apart is not None
    assert together.slip_m < 0.015  # drawn to the palm
    assert apart.slip_m > 0.025


def test_fingers_travel_alike_until_the_first_is_near(
    bar: Part, hand: HandDescription, firm: Grasp
) -> None:
    start = StartFinder.of(hand, DistanceField.of(bar.mesh))
    uneven = firm.pregrasp_joints.copy()
    finger = hand.fingers[0]
    uneven[finger.inner_joint] += 0.3
    uneven[finger.distal_joint] += 0.1
    _, before = motors_from_joints(hand, uneven)
    arrived = start.together(firm.T_object_palm, uneven)
    _, after = motors_from_joints(hand, arrived)
    way = (after - before)[0]
    assert way == pytest.approx(np.full(3, way[0]), abs=1e-9)
    assert way[0] > 0.1
    links = [link for finger in hand.fingers for link in finger.links]
    gap = start.clearance(firm.T_object_palm, arrived[None], links)[0]
    assert 0.003 <= gap < 0.008
