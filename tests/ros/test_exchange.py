"""Grasps in the forms of other packages."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import yaml
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Vector3, Vector3Stamped
from sensor_msgs.msg import JointState

from gpis_grasp_msgs.msg import Grasp
from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.ros.exchange import to_isaac_yaml, to_moveit


def pose(x: float) -> PoseStamped:
    return PoseStamped(pose=Pose(position=Point(x=x), orientation=Quaternion(z=0.6, w=0.8)))


GRASP = Grasp(
    mesh_id="mug",
    mesh_hash="0123456789",
    palm_pose=pose(1.0),
    flange_pose=pose(2.0),
    epsilon=0.25,
    pre_grasp=JointState(name=["a", "b"], position=[0.1, 0.2]),
    grasp=JointState(name=["a", "b"], position=[0.3, 0.4]),
    approach_direction=Vector3Stamped(vector=Vector3(z=-1.0)),
    approach_distance=0.08,
    lift_direction=Vector3Stamped(vector=Vector3(z=1.0)),
)


def test_the_isaac_file_can_be_read_back() -> None:
    data = yaml.safe_load(to_isaac_yaml([GRASP, GRASP], "object", "palm"))
    assert (data["format"], data["format_version"]) == ("isaac_grasp", "1.0")
    assert (data["object_frame_link"], data["gripper_frame_link"]) == ("object", "palm")
    assert list(data["grasps"]) == ["grasp_0", "grasp_1"]
    entry = data["grasps"]["grasp_0"]
    assert entry["confidence"] == 0.25
    assert entry["position"] == [1.0, 0.0, 0.0]
    assert entry["orientation"] == {"w": 0.8, "xyz": [0.0, 0.0, 0.6]}
    assert entry["cspace_position"] == {"a": 0.3, "b": 0.4}
    assert entry["pregrasp_cspace_position"] == {"a": 0.1, "b": 0.2}


def stand_in(name: str, *types: str) -> ModuleType:
    """A message package whose messages keep what they are given."""
    module = ModuleType(name)
    for kind in types:
        setattr(module, kind, type(kind, (SimpleNamespace,), {}))
    return module


def test_moveits_grasp_is_of_the_flange(monkeypatch: pytest.MonkeyPatch) -> None:
    """Against stand-ins: the package is not among the ROS wheels."""
    for package, types in {
        "moveit_msgs": ("Grasp", "GripperTranslation"),
        "trajectory_msgs": ("JointTrajectory", "JointTrajectoryPoint"),
    }.items():
        monkeypatch.setitem(sys.modules, package, ModuleType(package))
        monkeypatch.setitem(sys.modules, f"{package}.msg", stand_in(f"{package}.msg", *types))
    made: Any = to_moveit(GRASP)
    assert made.id == "mug 01234567"
    assert made.grasp_pose.pose.position.x == 2.0
    assert made.grasp_quality == 0.25
    assert made.grasp_posture.joint_names == ["a", "b"]
    assert made.grasp_posture.points[0].positions == [0.3, 0.4]
    assert made.pre_grasp_posture.points[0].positions == [0.1, 0.2]
    assert made.pre_grasp_approach.desired_distance == 0.08
    assert made.pre_grasp_approach.direction.vector.z == -1.0
    assert made.post_grasp_retreat.direction.vector.z == 1.0
    assert made.allowed_touch_objects == ["mug"]


def test_what_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "moveit_msgs", None)
    monkeypatch.setitem(sys.modules, "moveit_msgs.msg", None)
    with pytest.raises(RequestError, match=r"moveit_msgs.* is not installed"):
        to_moveit(GRASP)
