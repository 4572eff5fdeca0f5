"""The frames of the hand put its links where the kinematics have them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from geometry_msgs.msg import Point, Quaternion

from gpis_grasp_msgs.msg import Grasp
from gpis_grasp_planner.geometry.transforms import from_position_quat_xyzw
from gpis_grasp_planner.hand.description import available_hands, load_hand
from gpis_grasp_planner.hand.fixed_links import FixedFrame
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.ros.hand_frames import hand_frames


@pytest.mark.parametrize("name", available_hands())
def test_links_composed_from_the_frames_are_those_of_the_kinematics(
    name: str, rng: np.random.Generator
) -> None:
    hand = load_hand(name)
    joints = rng.uniform(hand.joint_lower, hand.joint_upper)
    quat = rng.standard_normal(4)
    quat /= np.linalg.norm(quat)
    grasp = Grasp()
    grasp.palm_pose.header.frame_id = "cell"
    grasp.palm_pose.header.stamp.sec = 7
    grasp.palm_pose.pose.position = Point(x=0.1, y=-0.2, z=0.3)
    x, y, z, w = quat.tolist()
    grasp.palm_pose.pose.orientation = Quaternion(x=x, y=y, z=z, w=w)
    grasp.grasp.position = joints.tolist()

    poses = {"cell": np.eye(4)}
    for frame in hand_frames(hand, grasp, "seen/"):
        assert frame.header.stamp.sec == 7
        p, q = frame.transform.translation, frame.transform.rotation
        T = from_position_quat_xyzw([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])
        poses[frame.child_frame_id] = poses[frame.header.frame_id] @ T  # parents come first

    T_cell_palm = from_position_quat_xyzw([0.1, -0.2, 0.3], quat)
    expected = T_cell_palm @ link_transforms(hand, joints)[0]
    assert set(poses) == {"cell", *(f"seen/{link}" for link in hand.link_names)}
    found = np.array([poses[f"seen/{link}"] for link in hand.link_names])
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_links_that_are_one_body_with_others_are_frames_of_those() -> None:
    turned = from_position_quat_xyzw([0.0, 0.01, 0.03], [0.0, 0.0, 0.6, 0.8])
    outer = load_hand().link_names[-1]
    hand = dataclasses.replace(load_hand(), fixed_frames=(FixedFrame("tip", outer, turned),))
    grasp = Grasp()
    grasp.palm_pose.pose.orientation.w = 1.0
    grasp.grasp.position = [0.0] * hand.n_joints
    last = hand_frames(hand, grasp, "seen/")[-1]
    assert (last.header.frame_id, last.child_frame_id) == (f"seen/{outer}", "seen/tip")
    p, q = last.transform.translation, last.transform.rotation
    assert [p.x, p.y, p.z] == [0.0, 0.01, 0.03]
    np.testing.assert_allclose([q.x, q.y, q.z, q.w], [0.0, 0.0, 0.6, 0.8], atol=1e-12)
