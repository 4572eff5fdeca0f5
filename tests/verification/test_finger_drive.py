"""Fingers close with their coupling, wrap after breakaway, and press as hard as they may."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.verification.engines import make_engine
from gpis_grasp_planner.verification.finger_drive import Phase
from gpis_grasp_planner.verification.settings import VerificationSettings
from gpis_grasp_planner.verification.trial_world import TrialWorld

pytestmark = pytest.mark.parametrize("engine", ["bullet", "mujoco"])


def world_of(
    engine: str, hand: HandDescription, part: Part, settings: VerificationSettings
) -> TrialWorld:
    return TrialWorld(engine, make_engine(engine, hand, part, settings), hand, part, settings)


def angles(world: TrialWorld) -> np.ndarray:
    """(fingers, 2): inner and distal joint."""
    return np.array(
        [[state[0] for state in world.engine.joint_states(d.finger.joints)] for d in world.drives]
    )


def test_a_free_finger_keeps_its_coupling_to_the_end(
    engine: str, hand: HandDescription, make_box: Callable[..., Part]
) -> None:
    part = make_box(0.01, 0.01, 0.01)
    T = np.eye(4)
    T[2, 3] = 1.0
    with world_of(engine, hand, part, VerificationSettings()) as world:
        world.take_pieces([part.mesh.vertices])
        world.place(T, np.zeros(hand.n_joints))
        for drive in world.drives:
            drive.start()
        for _ in range(6):
            world.run(0.1)
            inner, distal = angles(world).T
            assert distal == pytest.approx(inner / 3, abs=0.01)
        assert inner == pytest.approx(0.6 * 1.2, abs=0.02)
        assert world.close()
        assert all(drive.phase is Phase.ENDED for drive in world.drives)
        assert angles(world)[:, 0] == pytest.approx(hand.joint_upper[2], abs=0.02)


def test_a_finger_presses_with_its_torque(
    engine: str, bar: Part, hand: HandDescription, firm: Grasp
) -> None:
    """The held bar takes from a finger a force of the tip force, by the lever of the contact.

    The force is normal at the contact of two round bodies, up to friction, which is taken away.
    """
    for tip_force in (8.0, 15.0):
        settings = VerificationSettings(tip_force_n=tip_force, friction=0.0)
        with world_of(engine, hand, bar, settings) as world:
            world.take_pieces([bar.mesh.vertices])
            start = firm.pregrasp_joints.copy()
            for finger in hand.fingers:
                start[finger.inner_joint] = firm.joints[finger.inner_joint] - 0.1
                start[finger.distal_joint] = start[finger.inner_joint] / 3
            world.place(firm.T_object_palm, start)
            assert world.close()
            world.run(0.1)
            inner, distal = angles(world).T
            planned = [firm.joints[finger.inner_joint] for finger in hand.fingers]
            assert inner == pytest.approx(planned, abs=0.03)
            assert distal == pytest.approx(inner / 3, abs=0.03)
            for drive in world.drives:
                links = (drive.finger.inner_link, drive.finger.distal_link)
                rows = [i for i, link in enumerate(firm.contacts.links) if link in links]
                lever = normal_lever(hand, firm, rows[0], drive.finger.inner_link)
                pressed = sum(world.engine.press_of(link) for link in links)
                print(drive.finger.name, pressed, lever, drive.tip_torque[0])
                assert drive.tip_torque[0] == pytest.approx(tip_force * 0.1106, rel=0.02)
                assert pressed * lever == pytest.approx(drive.tip_torque[0], rel=0.1)


def normal_lever(hand: HandDescription, grasp: Grasp, row: int, inner_link: int) -> float:
    """Lever [m] of a contact's normal about the axis of a finger's inner joint."""
    from gpis_grasp_planner.hand.kinematics import link_transforms

    T = grasp.T_object_palm @ link_transforms(hand, grasp.joints)[0, inner_link]
    arm = grasp.contacts.positions[row] - T[:3, 3]
    axis = T[:3, :3] @ hand.joint_axis[inner_link]
    return float(np.cross(arm, grasp.contacts.normals_inward[row]) @ axis)


def test_an_inner_link_that_meets_the_part_is_freed(
    engine: str,
    hand: HandDescription,
    make_box: Callable[..., Part],
    grasp_of: Callable[..., Grasp],
) -> None:
    """A tall box near the inner links: they stop, the distal links go on past a third."""
    part = make_box(0.06, 0.10, 0.10)
    grasp = grasp_of(part, np.array([0.0, 0.0, 0.145]))
    with world_of(engine, hand, part, VerificationSettings()) as world:
        world.take_pieces([part.mesh.vertices])
        world.place(grasp.T_object_palm, grasp.pregrasp_joints)
        assert world.close()
        inner, distal = angles(world).T
    planned = grasp.joints
    wrapped = [planned[f.distal_joint] > planned[f.inner_joint] / 3 + 0.05 for f in hand.fingers]
    assert any(wrapped), "the case is none of wrapping"
    assert inner == pytest.approx([planned[f.inner_joint] for f in hand.fingers], abs=0.05)
    assert distal == pytest.approx([planned[f.distal_joint] for f in hand.fingers], abs=0.06)
