"""Estimates as they come: what is kept and what forgotten; nothing leaves the callbacks."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, PoseWithCovariance
from std_msgs.msg import Header

from gpis_grasp_msgs.msg import PartPose, PartPoses
from gpis_grasp_planner.errors import ErrorCode, PoseError, RequestError
from gpis_grasp_planner.geometry.sidecar import Sidecar
from gpis_grasp_planner.geometry.transforms import from_position_quat_xyzw
from gpis_grasp_planner.ros import pose_source
from gpis_grasp_planner.ros.estimator_frames import EstimatorFrames
from gpis_grasp_planner.ros.pose_source import PoseSource
from gpis_grasp_planner.ros.settings import NodeSettings

NO_FRAMES = EstimatorFrames(lambda _mesh_id: Sidecar(), lambda _mesh_id: "")


class Log:
    """Remembers warnings."""

    def __init__(self) -> None:
        self.warnings: list[str] = []

    def warning(self, text: str) -> None:
        self.warnings.append(text)


class StandIn:
    """What PoseSource asks of a node, without a middleware."""

    def __init__(self) -> None:
        self.log = Log()
        self.subscribed: dict[str, Callable[[Any], None]] = {}

    def create_subscription(self, _kind: type, topic: str, callback: Any, **_: Any) -> None:
        self.subscribed[topic] = callback

    def get_logger(self) -> Log:
        return self.log

    def get_clock(self) -> Any:
        class Clock:
            nanoseconds = 10**18

            def now(self) -> Any:
                return self

        return Clock()

    def resolve_topic_name(self, name: str) -> str:
        return f"/{name}"


@pytest.fixture
def node() -> StandIn:
    return StandIn()


@pytest.fixture
def poses(node: StandIn, monkeypatch: pytest.MonkeyPatch) -> PoseSource:
    monkeypatch.setattr(pose_source, "WARNING_PERIOD_S", 0.0)
    return PoseSource(node, NodeSettings, NO_FRAMES)  # type: ignore[arg-type]


def part(mesh_id: str, entry: float = 0.0, frame: str = "cell") -> PartPose:
    pose = PoseWithCovariance()
    pose.pose.orientation.w = 1.0
    pose.covariance[0] = entry
    return PartPose(header=Header(frame_id=frame), mesh_id=mesh_id, pose=pose)


def send(node: StandIn, *parts: PartPose) -> None:
    node.subscribed["part_poses"](PartPoses(parts=list(parts)))


def test_an_enormous_covariance_is_refused_with_its_code(node: StandIn, poses: PoseSource) -> None:
    send(node, part("mug", 1e308))
    assert "covariance" in node.log.warnings[-1]
    with pytest.raises(PoseError, match="the limit is 1e") as caught:
        poses.newest("mug")
    assert caught.value.code == ErrorCode.INVALID_COVARIANCE
    send(node, part("mug", 1e-4))
    assert poses.newest("mug").frame_id == "cell"


def test_nothing_leaves_the_callback(
    node: StandIn, poses: PoseSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pose_source, "check_pose", lambda *_: 1 / 0)
    send(node, part("mug"))
    assert "could not be checked" in node.log.warnings[-1]


def test_names_that_no_catalogue_can_hold_are_not_kept(node: StandIn, poses: PoseSource) -> None:
    send(node, part("../../etc"), part(""), part("a" * 65), part("mug"))
    assert poses.names() == "mug"
    assert len(node.log.warnings) == 3


def test_a_flood_of_names_does_not_lock_out_a_real_part(
    node: StandIn, poses: PoseSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pose_source, "MAX_PARTS", 50)
    send(node, *(part(f"junk{k}") for k in range(500)))
    send(node, part("sphere"))
    assert poses.newest("sphere").frame_id == "cell"
    with pytest.raises(PoseError) as caught:
        poses.newest("junk0")
    assert caught.value.code == ErrorCode.NO_POSE_ESTIMATE


def test_estimates_expire_but_are_called_stale_before(
    node: StandIn, poses: PoseSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    send(node, part("mug"))
    arrival = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: arrival + 30.0)
    send(node, part("sphere"))
    with pytest.raises(PoseError) as caught:
        poses.newest("mug")
    assert caught.value.code == ErrorCode.STALE_POSE
    monkeypatch.setattr(time, "monotonic", lambda: arrival + 200.0)
    send(node, part("flask"))
    assert poses.names() == "flask"
    with pytest.raises(PoseError) as caught:
        poses.newest("mug")
    assert caught.value.code == ErrorCode.NO_POSE_ESTIMATE


def test_a_position_in_millimetres_is_refused_with_a_hint(node: StandIn, poses: PoseSource) -> None:
    far = part("mug")
    far.pose.pose.position.x = 600.0
    send(node, far)
    with pytest.raises(PoseError, match=r"workspace_radius_m.*millimetres.* 0.6 m") as caught:
        poses.newest("mug")
    assert caught.value.code == ErrorCode.OUTSIDE_WORKSPACE


class Frames:
    """Stands in for the listener: one frame that was seen at one time."""

    def __init__(self, stamp_ns: int | None) -> None:
        self.tree = self
        self.stamp_ns = stamp_ns
        self.asked: list[tuple[str, str, int]] = []
        self.on_frame: Callable[[str], None] = lambda _frame: None

    def knows(self, _frame: str) -> bool:
        return self.stamp_ns != 0

    def newest_stamp_ns(self, _frame: str) -> int | None:
        return self.stamp_ns

    def transform(self, target: str, source: str, stamp_ns: int) -> Any:
        self.asked.append((target, source, stamp_ns))
        return from_position_quat_xyzw([0.1, 0.2, 0.3], [0.0, 0.0, 0.0, 1.0])


TF = NodeSettings(pose_type="tf", object_frames=("cup=mug",), object_parent_frame="base")


def test_a_parts_frame_on_tf_is_its_pose_at_the_time_it_was_seen(node: StandIn) -> None:
    poses = PoseSource(node, lambda: TF, NO_FRAMES)  # type: ignore[arg-type]
    frames = Frames(10**18 - 2 * 10**9)
    poses.listen_to(frames)  # type: ignore[arg-type]
    pose = poses.newest("mug")
    assert frames.asked == [("base", "cup", 10**18 - 2 * 10**9)]
    assert (pose.frame_id, pose.stamp_ns) == ("base", 10**18 - 2 * 10**9)
    assert pose.T_world_object[:3, 3] == pytest.approx([0.1, 0.2, 0.3])
    frames.stamp_ns = 10**18 - 20 * 10**9
    with pytest.raises(PoseError) as caught:
        poses.newest("mug")
    assert caught.value.code == ErrorCode.STALE_POSE
    with pytest.raises(PoseError) as caught:
        poses.newest("sphere")
    assert caught.value.code == ErrorCode.NO_POSE_ESTIMATE


def test_of_tf_and_a_topic_that_names_the_part_the_newer_one_counts(node: StandIn) -> None:
    poses = PoseSource(node, lambda: TF, NO_FRAMES)  # type: ignore[arg-type]
    frames = Frames(0)  # tf has not heard of the part's frame
    poses.listen_to(frames)  # type: ignore[arg-type]
    named = part("mug")
    named.header.frame_id, named.header.stamp.sec = "camera", 10**9 - 2
    send(node, named)
    assert poses.newest("mug").frame_id == "camera"
    assert frames.asked == []
    frames.stamp_ns = 10**18 - 3 * 10**9
    assert poses.newest("mug").frame_id == "camera"
    frames.stamp_ns = 10**18 - 10**9
    assert poses.newest("mug").frame_id == "base"
    frames.stamp_ns = None  # a static frame is always of now
    assert poses.newest("mug").frame_id == "base"


def test_a_part_that_is_seen_on_tf_is_told_as_one_on_a_topic_is(node: StandIn) -> None:
    poses = PoseSource(node, lambda: TF, NO_FRAMES)  # type: ignore[arg-type]
    frames, told = Frames(1), list[Any]()
    poses.listen_to(frames)  # type: ignore[arg-type]
    poses.on_estimate = told.append
    frames.on_frame("gripper")
    assert told == []
    frames.on_frame("cup")
    assert told == ["mug"]


def test_estimates_of_another_time_are_forgotten(node: StandIn, poses: PoseSource) -> None:
    send(node, part("mug"), part("sphere"))
    assert poses.newest("mug").frame_id == "cell"
    poses.forget()
    with pytest.raises(PoseError) as caught:
        poses.newest("mug")
    assert caught.value.code == ErrorCode.NO_POSE_ESTIMATE
    assert poses.parts() == []


def test_a_detection_is_an_estimate_of_its_part(
    node: StandIn, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pose_source, "WARNING_PERIOD_S", 0.0)
    from vision_msgs.msg import (
        Detection3D,
        Detection3DArray,
        ObjectHypothesis,
        ObjectHypothesisWithPose,
    )

    settings = NodeSettings(pose_type="detection3d_array", class_ids=("12=mug",))
    poses = PoseSource(node, lambda: settings, NO_FRAMES)  # type: ignore[arg-type]
    seen = ObjectHypothesisWithPose(hypothesis=ObjectHypothesis(class_id="12", score=0.8))
    seen.pose.pose.orientation.w = 1.0
    seen.pose.pose.position.x = 0.4
    message = Detection3DArray(detections=[Detection3D(results=[seen])])
    message.header.frame_id = "camera"  # of the array, where the detection has none
    node.subscribed["detections"](message)
    pose = poses.newest("mug")
    assert pose.frame_id == "camera"
    assert pose.T_world_object[0, 3] == 0.4
    message.detections[0].header.frame_id = "lens"
    message.header.stamp.sec = 10**9 - 20  # of the image, where the detection says none
    node.subscribed["detections"](message)
    with pytest.raises(PoseError, match=r"20\.00 s old") as caught:
        poses.newest("mug")
    assert caught.value.code == ErrorCode.STALE_POSE
    message.detections[0].header.stamp.sec = 10**9 - 2
    node.subscribed["detections"](message)
    newer = poses.newest("mug")
    assert (newer.frame_id, newer.stamp_ns) == ("lens", (10**9 - 2) * 10**9)
    seen.pose.pose.position.x = 0.0  # a box alone is no pose: it would lie in the camera
    message.detections[0].bbox.center.position.x = 0.4
    poses.forget()
    node.subscribed["detections"](message)
    assert poses.parts() == []
    assert "a box and no pose" in node.log.warnings[-1]
    message.detections[0].bbox.center.position.x = 0.0
    node.subscribed["detections"](message)
    assert poses.parts() == ["mug"]


def test_a_type_that_is_not_installed_is_named(
    node: StandIn, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "vision_msgs", None)
    monkeypatch.setitem(sys.modules, "vision_msgs.msg", None)
    settings = NodeSettings(pose_type="detection3d_array")
    with pytest.raises(RequestError, match="vision_msgs is not installed"):
        PoseSource(node, lambda: settings, NO_FRAMES)  # type: ignore[arg-type]


def test_an_estimate_of_the_estimators_frame_is_told_as_the_pose_of_the_mesh(
    node: StandIn,
) -> None:
    """What a request carries is the mesh's own pose and stays; another part's estimate as well."""
    T_mesh_estimator = np.eye(4)
    T_mesh_estimator[:3, 3] = [0.0, 0.0, 0.05]
    frames = EstimatorFrames(
        lambda mesh_id: Sidecar(T_mesh_estimator=T_mesh_estimator if mesh_id == "mug" else None),
        lambda _mesh_id: "",
    )
    poses = PoseSource(node, NodeSettings, frames)  # type: ignore[arg-type]
    send(node, part("mug"), part("flask"))
    assert poses.newest("mug").T_world_object[:3, 3] == pytest.approx([0.0, 0.0, -0.05])
    assert poses.newest("flask").T_world_object[:3, 3] == pytest.approx([0.0, 0.0, 0.0])
    carried = PoseStamped(header=Header(frame_id="cell"))
    carried.pose.orientation.w = 1.0
    given = poses.from_request(carried)
    assert given is not None
    assert given.T_world_object[:3, 3] == pytest.approx([0.0, 0.0, 0.0])
