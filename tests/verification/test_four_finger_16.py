"""A hand whose joints have motors of their own, in both engines."""

from __future__ import annotations

import numpy as np
import pytest
from hand_models import closed_on

from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.verification.engines import make_engine
from gpis_grasp_planner.verification.finger_drive import FingerDrive
from gpis_grasp_planner.verification.protocol import verify
from gpis_grasp_planner.verification.settings import VerificationSettings

HAND = load_hand("four_finger_16")
ENGINES = ["bullet", "mujoco"]


@pytest.mark.parametrize("engine", ENGINES)
def test_a_box_between_three_fingers_and_the_thumb_holds(engine, make_box) -> None:
    part = make_box(0.06, 0.09, 0.04)
    grasp = closed_on(HAND, part, [0.0, 0.0, 0.11])
    [verdict] = verify(part, HAND, [grasp], VerificationSettings(engine=engine))
    print(np.degrees(HAND.of_fingers(grasp.joints)).round(1), verdict)
    assert verdict.held, verdict.cause
    assert verdict.largest_slip_mm < 5.0
    assert len(verdict.touching) >= 4


@pytest.mark.parametrize("engine", ENGINES)
def test_each_joint_holds_with_its_effort_and_presses_by_its_arm(engine, make_box) -> None:
    part = make_box(0.01, 0.01, 0.01)
    settings = VerificationSettings()
    finger = HAND.fingers[0]
    with make_engine(engine, HAND, part, settings) as made:
        drive = FingerDrive(made, HAND, finger, settings)
        effort = HAND.joint_effort[list(finger.joints)]
        np.testing.assert_array_equal(drive.hold_torque, effort)
        np.testing.assert_array_less(drive.tip_torque, effort)
        # 8 N at the tip of a straight finger: 23 and 9.5 mm from the last joint, 36 and 52 more
        arms = [np.hypot(along, 9.541) / 1000.0 for along in (111.0, 59.0, 23.0)]
        np.testing.assert_allclose(drive.tip_torque, 8.0 * np.array(arms), rtol=1e-9)
