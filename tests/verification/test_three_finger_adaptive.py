"""Fingers of three links in both engines: row after row, held by stops and by the part."""

from __future__ import annotations

import numpy as np
import pytest
from hand_models import closed_on

from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.verification.engines import make_engine
from gpis_grasp_planner.verification.finger_drive import Phase
from gpis_grasp_planner.verification.protocol import verify
from gpis_grasp_planner.verification.settings import VerificationSettings
from gpis_grasp_planner.verification.trial_world import TrialWorld

HAND = load_hand("three_finger_adaptive")


@pytest.mark.parametrize("engine", ["bullet", "mujoco"])
def test_a_free_finger_closes_link_after_link(engine, make_box) -> None:
    part = make_box(0.01, 0.01, 0.01)
    T = np.eye(4)
    T[2, 3] = 1.0
    settings = VerificationSettings(closing_time_s=6.0)
    world = TrialWorld(engine, make_engine(engine, HAND, part, settings), HAND, part, settings)
    with world:
        world.take_pieces([part.mesh.vertices])
        world.place(T, np.zeros(HAND.n_joints))
        for drive in world.drives:
            drive.start()
        seen = []
        for _ in range(30):
            world.run(0.1)
            seen.append([q for q, _ in world.engine.joint_states(HAND.fingers[0].joints)])
        upper = HAND.joint_upper[list(HAND.fingers[0].joints)]
        for q in np.array(seen):
            led = int(np.sum(q[:2] > upper[:2] - 0.02))  # joints at their stops
            np.testing.assert_allclose(q[:led], upper[:led], atol=0.02)
            np.testing.assert_allclose(q[led + 1 :], 0.0, atol=0.02)
        assert world.close()
        assert all(drive.phase is Phase.ENDED for drive in world.drives)
        q = [q for q, _ in world.engine.joint_states(HAND.fingers[0].joints)]
        np.testing.assert_allclose(q, upper, atol=0.03)


@pytest.mark.parametrize("engine", ["bullet", "mujoco"])
@pytest.mark.parametrize(
    ("height", "links"), [(0.21, 1), (0.112, 3)], ids=["between fingertips", "enclosed"]
)
def test_a_box_is_held_as_it_was_planned(engine, height, links, make_box) -> None:
    """One finger against two: the gears of the one hold what the others press with."""
    part = make_box(0.07, 0.05, 0.04)
    grasp = closed_on(HAND, part, np.array([0.0, 0.0, height]))
    q = HAND.of_fingers(grasp.joints)
    assert ((q > 0.1).sum(axis=1) == links).all()
    [verdict] = verify(part, HAND, [grasp], VerificationSettings(engine=engine))
    print(np.degrees(q).round(1), verdict)
    assert verdict.held, verdict.cause
    assert verdict.largest_slip_mm < 5.0
