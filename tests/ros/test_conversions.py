"""Where the plan meets the object's pose: recomputed here by quaternion algebra alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.transforms import from_position_quat_xyzw
from gpis_grasp_planner.grasp.arm_motion import ArmMotion
from gpis_grasp_planner.grasp.funnel import Funnel, Step
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.quality.figures import ALWAYS, Figure, Quality
from gpis_grasp_planner.ros.conversions import figure_messages, funnel_messages, grasp_message
from gpis_grasp_planner.ros.request_guard import ObjectPose
from gpis_grasp_planner.ros.worker.messages import Plan

HAND = load_hand()


def multiply(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Hamilton product of quaternions x, y, z, w."""
    vector = p[3] * q[:3] + q[3] * p[:3] + np.cross(p[:3], q[:3])
    return np.array([*vector, p[3] * q[3] - p[:3] @ q[:3]])


def rotate(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Turn a vector by a unit quaternion: q v q*."""
    conjugate = q * [-1, -1, -1, 1]
    return multiply(multiply(q, np.array([*v, 0.0])), conjugate)[:3]


def xyz(message: object) -> np.ndarray:
    return np.array([message.x, message.y, message.z])


def test_the_funnel_goes_out_as_it_is() -> None:
    funnel = Funnel(
        10, {(Step.PALM_FREE, "support"): 3, (Step.CLOSED, "hand meets itself"): 1}, Step.CLOSED
    )
    messages = funnel_messages(funnel)
    assert [message.name for message in messages] == ["proposed", "palm free", "closed"]
    assert [message.passed for message in messages] == [10, 7, 6]
    assert [list(message.causes) for message in messages] == [
        [],
        ["support"],
        ["hand meets itself"],
    ]
    assert [list(message.lost) for message in messages] == [[], [3], [1]]
    assert funnel_messages(Funnel()) == []


@pytest.mark.parametrize("run", range(5))
def test_the_pose_out_is_the_estimate_times_the_planned_grasp(
    run: int, rng: np.random.Generator
) -> None:
    q_object, q_palm = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 4)))
    p_object, p_palm = rng.normal(size=(2, 3))
    normals = rng.normal(size=(4, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    T_object_palm = from_position_quat_xyzw(p_palm, q_palm)
    grasp = Grasp(
        T_object_palm=T_object_palm,
        joints=rng.uniform(0, 1, 8),
        pregrasp_joints=rng.uniform(0, 1, 8),
        contacts=Contacts(
            rng.normal(size=(4, 3)), normals, rng.uniform(0.2, 1, 4), np.array([0, 4, 5, 6])
        ),
        quality=Quality(0.1, 0.02),
        approach_direction=T_object_palm[:3, 2],
        approach_distance=0.1,
    )
    plan = Plan(ErrorCode.SUCCESS, "", "mug", "abc", (grasp,), None, (), 10, 1.0)
    pose = ObjectPose(
        from_position_quat_xyzw(p_object, q_object), "camera", 12_000_000_034, None, ()
    )

    message = grasp_message(grasp, plan, pose, HAND)

    out = message.palm_pose.pose
    assert np.allclose(xyz(out.position), p_object + rotate(q_object, p_palm), atol=1e-12)
    quat = np.array([*xyz(out.orientation), out.orientation.w])
    expected = multiply(q_object, q_palm)
    assert np.isclose(abs(quat @ expected), 1.0, atol=1e-12)
    assert quat[3] >= 0.0
    z = rotate(expected, np.array([0.0, 0.0, 1.0]))
    assert np.allclose(xyz(message.approach_direction.vector), z, atol=1e-12)
    assert np.allclose(xyz(message.lift_direction.vector), -z, atol=1e-12)
    assert message.hold_probability == -1.0
    lifted = replace(grasp, lift_direction=np.array([0.6, 0.0, 0.8]), hold_probability=0.75)
    placed = grasp_message(lifted, plan, pose, HAND)
    up = rotate(q_object, np.array([0.6, 0.0, 0.8]))
    assert np.allclose(xyz(placed.lift_direction.vector), up, atol=1e-12)
    assert placed.hold_probability == 0.75
    assert not message.arm_grasp.name
    assert message.arm_manipulability == -1.0
    way, lift = rng.normal(size=(2, 5, 2))
    carried = replace(grasp, arm=ArmMotion("mine", ("a", "b"), way, lift, 0.25))
    carried_message = grasp_message(carried, plan, pose, HAND)
    for state, joints in (
        (carried_message.arm_pre_grasp, way[0]),
        (carried_message.arm_grasp, way[-1]),
        (carried_message.arm_lifted, lift[-1]),
    ):
        assert list(state.name) == ["a", "b"]
        assert np.array_equal(state.position, joints)
    assert carried_message.arm_manipulability == 0.25
    back = xyz(message.pre_grasp_palm_pose.pose.position)
    assert np.allclose(back, xyz(out.position) - 0.1 * z, atol=1e-12)
    assert message.pre_grasp_palm_pose.pose.orientation == out.orientation
    for contact, position, normal, mu, link in zip(
        message.contacts,
        grasp.contacts.positions,
        normals,
        grasp.contacts.friction,
        grasp.contacts.links,
        strict=True,
    ):
        assert np.allclose(xyz(contact.position), p_object + rotate(q_object, position), atol=1e-12)
        assert np.allclose(xyz(contact.normal_inward), rotate(q_object, normal), atol=1e-12)
        assert contact.friction == mu
        assert contact.link == HAND.link_names[link]
    headers = [
        message.palm_pose.header,
        message.pre_grasp_palm_pose.header,
        message.grasp.header,
        message.pre_grasp.header,
        message.approach_direction.header,
        message.lift_direction.header,
    ]
    for header in headers:
        assert (header.frame_id, header.stamp.sec, header.stamp.nanosec) == ("camera", 12, 34)
    assert list(message.grasp.name) == list(HAND.joint_names)
    assert np.array_equal(message.grasp.position, grasp.joints)
    assert np.array_equal(message.pre_grasp.position, grasp.pregrasp_joints)
    assert (message.epsilon, message.volume) == (0.1, 0.02)
    assert [(f.name, f.value) for f in message.figures] == [("epsilon", 0.1), ("volume", 0.02)]
    assert (message.mesh_id, message.mesh_hash) == ("mug", "abc")


def test_every_figure_with_a_meaning_goes_out_with_it() -> None:
    stiffness = Figure("stiffness", "N/m", False, "How little it gives.", "A user's own.")
    quality = Quality(0.1, 0.02, 0.5, {"stiffness": 7.0, "nobody_knows": 1.0})
    messages = figure_messages(quality, (*ALWAYS, stiffness))
    assert [(m.name, m.value, m.unit, m.larger_is_better) for m in messages] == [
        ("epsilon", 0.1, "", True),
        ("volume", 0.02, "", True),
        ("imbalance", 0.5, "", False),
        ("stiffness", 7.0, "N/m", False),
    ]
