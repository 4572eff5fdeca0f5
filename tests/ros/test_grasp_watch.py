"""A published grasp read back is the grasp that was planned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.transforms import from_position_quat_xyzw
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.trials import TrialOutcome, Trials
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.open_hand import JointCount
from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.quality.figures import Quality
from gpis_grasp_planner.ros.conversions import MeshVersion, grasp_message, pose_message
from gpis_grasp_planner.ros.grasp_watch import seen_grasp
from gpis_grasp_planner.ros.request_guard import ObjectPose

HAND = load_hand()


def unit(rng: np.random.Generator, *shape: int) -> np.ndarray:
    v = rng.standard_normal(shape)
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


@pytest.fixture
def grasp(rng: np.random.Generator) -> Grasp:
    return Grasp(
        T_object_palm=from_position_quat_xyzw(rng.standard_normal(3), unit(rng, 4)),
        joints=rng.uniform(HAND.joint_lower, HAND.joint_upper),
        pregrasp_joints=rng.uniform(HAND.joint_lower, HAND.joint_upper),
        contacts=Contacts(
            positions=rng.standard_normal((3, 3)),
            normals_inward=unit(rng, 3, 3),
            friction=np.array([0.4, 0.5, 0.6]),
            links=np.array([0, 3, 5]),
        ),
        quality=Quality(0.12, 0.03),
        approach_direction=unit(rng, 3),
        approach_distance=0.07,
        trials=Trials((TrialOutcome("nominal", True), TrialOutcome("slippery", False, "slip"))),
        hold_probability=0.8,
        lift_direction=unit(rng, 3),
    )


def test_message_and_back(grasp: Grasp, rng: np.random.Generator) -> None:
    T = from_position_quat_xyzw(rng.standard_normal(3), unit(rng, 4))
    pose = ObjectPose(T_world_object=T, frame_id="cell", stamp_ns=5, covariance=None, notes=())
    message = grasp_message(grasp, MeshVersion("mug", "abc"), pose, HAND)
    stamped = PoseStamped(header=message.palm_pose.header, pose=pose_message(T))
    seen = seen_grasp(message, stamped, HAND)
    assert (seen.mesh_id, seen.mesh_hash, seen.frame_id) == ("mug", "abc", "cell")
    np.testing.assert_allclose(seen.T_world_object, T, atol=1e-12)
    back = seen.grasp
    for name in ("T_object_palm", "joints", "pregrasp_joints", "approach_direction"):
        np.testing.assert_allclose(getattr(back, name), getattr(grasp, name), atol=1e-12)
    for name in ("positions", "normals_inward", "friction", "links"):
        found, wanted = getattr(back.contacts, name), getattr(grasp.contacts, name)
        np.testing.assert_allclose(found, wanted, atol=1e-12)
    np.testing.assert_allclose(back.way_out, grasp.way_out, atol=1e-12)
    assert (back.epsilon, back.volume) == (grasp.epsilon, grasp.volume)
    assert (back.approach_distance, back.hold_probability) == (0.07, 0.8)
    assert back.trials is not None
    assert [(t.name, t.passed) for t in back.trials.outcomes] == [
        ("nominal", True),
        ("slippery", False),
    ]


def test_joints_go_out_as_the_urdf_counts_them_and_come_back(grasp: Grasp) -> None:
    n = HAND.n_joints
    count = JointCount(0.1 * np.arange(n), np.where(np.arange(n) % 2, -1.0, 1.0))
    hand = replace(HAND, joint_count=count)
    pose = ObjectPose(np.eye(4), "cell", stamp_ns=5, covariance=None, notes=())
    message = grasp_message(grasp, MeshVersion("mug", "abc"), pose, hand)
    np.testing.assert_allclose(message.grasp.position, count.zero + count.sense * grasp.joints)
    stamped = PoseStamped(header=message.palm_pose.header, pose=pose_message(np.eye(4)))
    back = seen_grasp(message, stamped, hand).grasp
    np.testing.assert_allclose(back.joints, grasp.joints, atol=1e-15)
    np.testing.assert_allclose(back.pregrasp_joints, grasp.pregrasp_joints, atol=1e-15)


def test_another_hand_than_the_nodes_is_refused(grasp: Grasp) -> None:
    pose = ObjectPose(
        T_world_object=np.eye(4), frame_id="cell", stamp_ns=5, covariance=None, notes=()
    )
    message = grasp_message(grasp, MeshVersion("mug"), pose, HAND)
    with pytest.raises(RequestError, match="--hand"):
        seen_grasp(message, PoseStamped(), load_hand("parallel_jaw"))
