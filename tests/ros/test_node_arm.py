"""A node with an arm behind the hand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from arm_tables import dh_flange
from geometry_msgs.msg import PoseStamped

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.transforms import from_position_quat_xyzw


def test_answers_carry_the_arms_joints_and_end_at_its_reach(
    client: Any, start_node: Callable[..., Any]
) -> None:
    node = start_node({"arm.model": "six_axis", "arm_frame": "world"})
    node.wait_ready()
    fields = {"time_budget": 10.0, "n_grasps": 3, "verification": "none"}
    response = client.plan("mug", object_pose=at(0.5), **fields)
    assert response.success, response.message
    check(response.grasps)
    # from memory, 10 cm farther: the joints are those of this pose
    response = client.plan("mug", object_pose=at(0.6), **fields)
    assert response.success, response.message
    check(response.grasps)
    far = client.plan("mug", object_pose=at(2.0), **{**fields, "time_budget": 2.0})
    assert far.code == ErrorCode.ALL_GRASPS_BLOCKED
    assert not far.grasps
    assert "arm" in far.message
    assert node.end() == 0


def test_an_arm_without_its_frame_is_refused(client: Any, start_node: Callable[..., Any]) -> None:
    node = start_node({"arm.model": "six_axis"})
    node.wait_ready()
    response = client.plan("mug")
    assert response.code == ErrorCode.INVALID_SCENE
    assert "arm_frame is empty" in response.message
    assert node.end() == 0


def at(x: float) -> PoseStamped:
    """The object at x of the frame "world", a little above its plane."""
    pose = PoseStamped()
    pose.header.frame_id = "world"
    pose.pose.position.x, pose.pose.position.z = x, 0.2
    return pose


def check(grasps: Any) -> None:
    """The arm's joints take the flange to the answered poses, by the published table."""
    for grasp in grasps:
        assert 0.0 < grasp.arm_manipulability <= 1.0
        for state, pose in (
            (grasp.arm_grasp, grasp.flange_pose.pose),
            (grasp.arm_pre_grasp, grasp.pre_grasp_palm_pose.pose),
        ):
            assert list(state.name) == [f"joint_{i}" for i in range(1, 7)]
            p, q = pose.position, pose.orientation
            expected = from_position_quat_xyzw([p.x, p.y, p.z], [q.x, q.y, q.z, q.w])
            found = dh_flange("six_axis", np.array(state.position))
            np.testing.assert_allclose(found, expected, atol=1e-6)
