"""Fingers close with their coupling, wrap after breakaway, and press as hard as they may."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.verification.bullet.drive import Phase
from gpis_grasp_planner.verification.bullet.trial import TrialWorld
from gpis_grasp_planner.verification.settings import VerificationSettings


def angles(world: TrialWorld) -> np.ndarray:
    """(fingers, 2): inner and distal joint."""
    return np.array(
        [
            [s[0] for s in world.client.getJointStates(d.body, [d.inner, d.distal])]
            for d in world.drives
        ]
    )


def test_a_free_finger_keeps_its_coupling_to_the_end(
    hand: HandDescription, make_box: Callable[..., Part]
) -> None:
    part = make_box(0.01, 0.01, 0.01)
    T = np.eye(4)
    T[2, 3] = 1.0
    with TrialWorld(hand, part, VerificationSettings()) as world:
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


def torque_of_contacts(world: TrialWorld, links: tuple[int, int], inner: int) -> float:
    """Torque [N m] about an inner joint's axis that the contacts of links resist.

    PyBullet's friction forces have the sign of the reaction on the other body.
    """
    client, body = world.client, world.drives[0].body
    state = client.getLinkState(body, inner, computeForwardKinematics=True)
    origin = np.array(state[4])
    axis = np.array(client.getMatrixFromQuaternion(state[5])).reshape(3, 3)[:, 2]
    torque = np.zeros(3)
    for link in links:
        for row in client.getContactPoints(bodyA=body, linkIndexA=link):
            lateral = row[10] * np.array(row[11]) + row[12] * np.array(row[13])
            torque += np.cross(np.array(row[5]) - origin, row[9] * np.array(row[7]) - lateral)
    return float(-torque @ axis)


def test_a_finger_presses_with_its_torque(bar: Part, hand: HandDescription, firm: Grasp) -> None:
    """What the held part takes from a finger is the torque of the full force at its tip."""
    for tip_force in (8.0, 15.0):
        settings = VerificationSettings(tip_force_n=tip_force)
        with TrialWorld(hand, bar, settings) as world:
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
                resisted = torque_of_contacts(world, (drive.inner, drive.distal), drive.inner)
                print(drive.finger.name, resisted, drive.tip_torque[0])
                assert drive.tip_torque[0] == pytest.approx(tip_force * 0.1106, rel=0.02)
                assert resisted == pytest.approx(drive.tip_torque[0], rel=0.1)


def test_an_inner_link_that_meets_the_part_is_freed(
    hand: HandDescription, make_box: Callable[..., Part], grasp_of: Callable[..., Grasp]
) -> None:
    """A tall box near the inner links: they stop, the distal links go on past a third."""
    part = make_box(0.06, 0.10, 0.10)
    grasp = grasp_of(part, np.array([0.0, 0.0, 0.145]))
    with TrialWorld(hand, part, VerificationSettings()) as world:
        world.take_pieces([part.mesh.vertices])
        world.place(grasp.T_object_palm, grasp.pregrasp_joints)
        assert world.close()
        inner, distal = angles(world).T
    planned = grasp.joints
    wrapped = [planned[f.distal_joint] > planned[f.inner_joint] / 3 + 0.05 for f in hand.fingers]
    assert any(wrapped), "the case is none of wrapping"
    assert inner == pytest.approx([planned[f.inner_joint] for f in hand.fingers], abs=0.05)
    assert distal == pytest.approx([planned[f.distal_joint] for f in hand.fingers], abs=0.06)
