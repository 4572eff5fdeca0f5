"""Object poses from topics: the newest estimate per part, kept unchecked until it is used.

A bad estimate is logged when it comes and refused when it is asked for: going back to an older
one, which the part may have left, would be a wrong grasp.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from geometry_msgs.msg import Pose, PoseStamped, PoseWithCovarianceStamped
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from std_msgs.msg import Header

from gpis_grasp_msgs.msg import PartPoses
from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError, PoseError, RequestError
from gpis_grasp_planner.geometry.catalogue import ID_PATTERN
from gpis_grasp_planner.geometry.transforms import to_position_quat_xyzw
from gpis_grasp_planner.ros.detections import chosen_instances, mapping_of, only_a_box
from gpis_grasp_planner.ros.estimator_frames import EstimatorFrames
from gpis_grasp_planner.ros.request_guard import NANOSECONDS, ObjectPose, RawPose, check_pose
from gpis_grasp_planner.ros.scene_defaults import point_of_text
from gpis_grasp_planner.ros.settings import NodeSettings
from gpis_grasp_planner.ros.text import printable
from gpis_grasp_planner.ros.tf_listener import TfListener

OBJECT_POSE_TOPIC = "object_pose"
PART_POSES_TOPIC = "part_poses"
DETECTIONS_TOPIC = "detections"

# A best-effort, volatile subscription matches publishers of either reliability and durability.
ESTIMATE_QOS = QoSProfile(
    depth=10,
    reliability=QoSReliabilityPolicy.BEST_EFFORT,
    durability=QoSDurabilityPolicy.VOLATILE,
)
# Of part_poses: a stray publisher must not fill the memory; the oldest go first.
MAX_PARTS = 1000
# An estimate that nobody can use any more is forgotten after so many times the allowed age.
FORGET_AFTER_AGES = 10.0
FORGET_AFTER_S = 60.0
# A broken estimator at 100 Hz shall not fill the log.
WARNING_PERIOD_S = 5.0


class PoseSource:
    """Subscribes to the estimates and answers where a part lies.

    Parameters
    ----------
    node : Node
    settings : callable
        Gives the node's settings at the moment of the call.
    estimators : EstimatorFrames

    Attributes
    ----------
    on_estimate : callable
        Called with the mesh ID of each good estimate, None for one that names no part.
    """

    def __init__(
        self, node: Node, settings: Callable[[], NodeSettings], estimators: EstimatorFrames
    ) -> None:
        self._node = node
        self._settings = settings
        self._estimators = estimators
        self._lock = threading.Lock()
        self._untagged: RawPose | None = None
        self._by_part: dict[str, RawPose] = {}
        self._last_warning_s = -WARNING_PERIOD_S
        self.on_estimate: Callable[[str | None], None] = lambda _mesh_id: None
        self._frames: TfListener | None = None
        self._subscribe(settings().pose_type)
        node.create_subscription(
            PartPoses, PART_POSES_TOPIC, self._on_part_poses, qos_profile=ESTIMATE_QOS
        )

    def _subscribe(self, pose_type: str) -> None:
        kinds: dict[str, tuple[Any, str, Callable[[Any], None]]] = {
            "pose_stamped": (PoseStamped, OBJECT_POSE_TOPIC, self._on_pose),
            "pose_with_covariance_stamped": (
                PoseWithCovarianceStamped,
                OBJECT_POSE_TOPIC,
                self._on_pose_with_covariance,
            ),
        }
        if pose_type == "detection3d_array":
            try:
                from vision_msgs.msg import Detection3DArray
            except ImportError:
                raise RequestError(
                    "Setting 'pose_type' is 'detection3d_array', and the package vision_msgs is "
                    "not installed. Install ros-jazzy-vision-msgs, or choose another type."
                ) from None
            kinds[pose_type] = Detection3DArray, DETECTIONS_TOPIC, self._on_detections
        self._topic = PART_POSES_TOPIC
        if pose_type in kinds:
            kind, self._topic, callback = kinds[pose_type]
            self._node.create_subscription(kind, self._topic, callback, qos_profile=ESTIMATE_QOS)

    def listen_to(self, frames: TfListener) -> None:
        """Take poses of parts from tf, where `pose_type` says so."""
        if self._settings().pose_type == "tf":
            self._frames = frames
            frames.on_frame = self._on_frame

    def newest(self, mesh_id: str) -> ObjectPose:
        """The newest estimate for a part, checked at this moment, as the pose of its mesh.

        An estimate that names the part (``part_poses``) goes before one that names none
        (``object_pose``), however new: with several parts about, the latter may be of another.

        Raises
        ------
        PoseError
            NO_POSE_ESTIMATE, or what is wrong with the newest one.
        """
        with self._lock:
            named, raw = self._by_part.get(mesh_id), self._untagged
            others = sorted(self._by_part)
        raw = self._from_tf(mesh_id, named) or named or raw
        if raw is None:
            seen = ""
            if others:
                names = ", ".join(printable(name, 40) for name in others[:5])
                seen = f" Estimates came only for: {names}."
            raise PoseError(
                f"There is no pose estimate for '{mesh_id}' yet.{seen} Publish one on "
                f"'{self._node.resolve_topic_name(self._topic)}' or "
                f"'{self._node.resolve_topic_name(PART_POSES_TOPIC)}', or give object_pose in "
                "the request.",
                ErrorCode.NO_POSE_ESTIMATE,
            )
        return self._estimators.pose_of_mesh(mesh_id, self.checked(raw))

    def forget(self) -> None:
        """Forget all estimates: their stamps are of another time."""
        with self._lock:
            self._untagged = None
            self._by_part.clear()

    def from_request(self, message: PoseStamped) -> ObjectPose | None:
        """The pose a request carries, checked; None where it carries none.

        Raises
        ------
        PoseError
            EMPTY_FRAME for a pose that is filled in but has no frame: ignoring it would plan for
            another place than the caller meant.
        """
        if not message.header.frame_id and not _filled_in(message):
            return None
        return self.checked(self._raw("the request's object_pose", message.header, message.pose))

    def checked(self, raw: RawPose) -> ObjectPose:
        """Check a pose at this moment."""
        now_ns = self._node.get_clock().now().nanoseconds
        pose = check_pose(raw, now_ns, time.monotonic(), self._settings())
        for note in pose.notes:
            self._warn(note)
        return pose

    def parts(self) -> list[str]:
        """Mesh IDs of the parts that have an estimate by name, sorted."""
        with self._lock:
            return sorted(self._by_part)

    def names(self) -> str:
        """Which parts have an estimate, for people; at most twenty by name."""
        with self._lock:
            parts = list(self._by_part)
            untagged = self._untagged is not None
        shown = [*sorted(parts)[:20], *(["..."] if len(parts) > 20 else [])]
        return ", ".join([*([f"({OBJECT_POSE_TOPIC})"] if untagged else []), *shown]) or "none"

    def _on_pose(self, message: PoseStamped) -> None:
        raw = self._raw(f"the estimate on {OBJECT_POSE_TOPIC}", message.header, message.pose)
        self._take(None, raw)

    def _on_pose_with_covariance(self, message: PoseWithCovarianceStamped) -> None:
        raw = self._raw(
            f"the estimate on {OBJECT_POSE_TOPIC}",
            message.header,
            message.pose.pose,
            tuple(message.pose.covariance),
        )
        self._take(None, raw)

    def _on_detections(self, message: Any) -> None:
        settings = self._settings()
        near = settings.instance_point
        posed = [each for each in message.detections if not only_a_box(each)]
        if len(posed) < len(message.detections):
            self._warn(
                f"{len(message.detections) - len(posed)} detections on {DETECTIONS_TOPIC} have a "
                "box and no pose of the part; left out. Fill in the pose of their results."
            )
        chosen = chosen_instances(
            posed,
            mapping_of(settings.class_ids, "class_ids"),
            settings.min_score,
            point_of_text(near, "instance_point") if near else None,
        )
        for mesh_id, (header, hypothesis) in chosen.items():
            raw = self._raw(
                f"the detection of '{printable(mesh_id, 64)}' on {DETECTIONS_TOPIC}",
                _header(header, message.header),
                hypothesis.pose.pose,
                tuple(hypothesis.pose.covariance),
            )
            self._take(mesh_id, raw)

    def _from_tf(self, mesh_id: str, named: RawPose | None) -> RawPose | None:
        """The pose of a part's frame on tf, at the time it was last seen there.

        None where a topic `named` the part, and tf has not heard of its frame, or not since.
        """
        settings = self._settings()
        if self._frames is None:
            return None
        frames = mapping_of(settings.object_frames, "object_frames")
        frame = next((f for f, m in frames.items() if m == mesh_id), None)
        if frame is None:
            return None
        parent = settings.object_parent_frame
        stamp_ns = self._frames.tree.newest_stamp_ns(frame)
        now_ns = self._node.get_clock().now().nanoseconds
        if named is not None and (
            not self._frames.tree.knows(frame)
            or (stamp_ns is not None and stamp_ns < named.stamped_ns)
        ):
            return None
        T = self._frames.transform(parent, frame, now_ns if stamp_ns is None else stamp_ns)
        position, quat = to_position_quat_xyzw(T)
        seconds, nanoseconds = divmod(stamp_ns or 0, NANOSECONDS)
        return RawPose(
            source=f"the frame '{printable(frame, 60)}' on tf",
            frame_id=parent,
            stamp_sec=seconds,
            stamp_nanosec=nanoseconds,
            position=(float(position[0]), float(position[1]), float(position[2])),
            quat_xyzw=(float(quat[0]), float(quat[1]), float(quat[2]), float(quat[3])),
            covariance=None,
            arrival_ns=now_ns,
            arrival_steady_s=time.monotonic(),
        )

    def _on_frame(self, frame: str) -> None:
        """Tell that a part was seen on tf."""
        mesh_id = _part_of_frame(self._settings().object_frames).get(frame)
        if mesh_id is not None:
            self.on_estimate(mesh_id)

    def _on_part_poses(self, message: PartPoses) -> None:
        for part in message.parts:
            raw = self._raw(
                f"the estimate of '{printable(part.mesh_id, 64)}' on {PART_POSES_TOPIC}",
                part.header,
                part.pose.pose,
                tuple(part.pose.covariance),
            )
            self._take(part.mesh_id, raw)

    def _take(self, mesh_id: str | None, raw: RawPose) -> None:
        if mesh_id is not None and ID_PATTERN.fullmatch(mesh_id) is None:
            self._warn(f"{raw.source}: no catalogue can hold that mesh ID; ignored.")
            return
        with self._lock:
            if mesh_id is None:
                self._untagged = raw
            else:
                self._by_part.pop(mesh_id, None)
                self._by_part[mesh_id] = raw  # at the end: the dictionary is in order of arrival
            self._forget_old(raw.arrival_steady_s)
        try:
            self.checked(raw)
            self.on_estimate(mesh_id)
        except GraspPlannerError as error:
            self._warn(error.message)
        except Exception as error:
            # An estimate that a check did not foresee must not leave this callback.
            self._warn(f"{raw.source} could not be checked: {error!r:.200}")

    def _forget_old(self, now_s: float) -> None:
        keep_s = max(FORGET_AFTER_S, FORGET_AFTER_AGES * self._settings().max_pose_age_s)
        for mesh_id, raw in list(self._by_part.items()):
            if len(self._by_part) <= MAX_PARTS and now_s - raw.arrival_steady_s <= keep_s:
                break
            del self._by_part[mesh_id]

    def _raw(
        self,
        source: str,
        header: Header,
        pose: Pose,
        covariance: tuple[float, ...] | None = None,
    ) -> RawPose:
        p, q = pose.position, pose.orientation
        return RawPose(
            source=source,
            frame_id=header.frame_id,
            stamp_sec=header.stamp.sec,
            stamp_nanosec=header.stamp.nanosec,
            position=(p.x, p.y, p.z),
            quat_xyzw=(q.x, q.y, q.z, q.w),
            covariance=covariance,
            arrival_ns=self._node.get_clock().now().nanoseconds,
            arrival_steady_s=time.monotonic(),
        )

    def _warn(self, text: str) -> None:
        now = time.monotonic()
        if now - self._last_warning_s >= WARNING_PERIOD_S:
            self._last_warning_s = now
            self._node.get_logger().warning(printable(text, 400))


@lru_cache(maxsize=1)
def _part_of_frame(object_frames: tuple[str, ...]) -> dict[str, str]:
    """Asked for every frame on tf."""
    frames = mapping_of(object_frames, "object_frames")
    return {name.lstrip("/"): mesh_id for name, mesh_id in frames.items()}


def _header(own: Header, of_array: Header) -> Header:
    """That of a detection: the array's where it has no frame, its stamp where it has none."""
    if not own.frame_id:
        return of_array
    stamped = own.stamp.sec or own.stamp.nanosec
    return own if stamped else Header(frame_id=own.frame_id, stamp=of_array.stamp)


def _filled_in(message: PoseStamped) -> bool:
    """Whether anything differs from a message that nobody touched (all zero, or w = 1)."""
    p, q, stamp = message.pose.position, message.pose.orientation, message.header.stamp
    untouched = (p.x, p.y, p.z, q.x, q.y, q.z) == (0.0,) * 6 and q.w in (0.0, 1.0)
    return not untouched or (stamp.sec, stamp.nanosec) != (0, 0)
