"""What stands around a part: from the request and the parameters, checked before any planning."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from numpy.typing import NDArray

from gpis_grasp_msgs.msg import Obstacle
from gpis_grasp_planner.arm.description import load_arm
from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError, PoseError, RequestError
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.transforms import inverse, to_position_quat_xyzw
from gpis_grasp_planner.ros.grasp_request import GraspRequest
from gpis_grasp_planner.ros.request_guard import ObjectPose
from gpis_grasp_planner.ros.scene_defaults import obstacles_of, pose_of_text, read_far_position
from gpis_grasp_planner.ros.settings import NO_FLANGE, NodeSettings
from gpis_grasp_planner.ros.text import printable
from gpis_grasp_planner.surroundings.covariance import covariance_in_object
from gpis_grasp_planner.surroundings.obstacles import Surroundings, read_pose
from gpis_grasp_planner.surroundings.place import STAND_IN, Place

Array = NDArray[np.float64]

SUPPORT = "support"
# A part further away from its frame's origin: positions are counted from the part instead.
_NEAR_M = 50.0
# What is further away from the part does not concern its grasps.
_REACH_M = 100.0

Transform = Callable[[str, str, int], Array]


def _no_transform(target: str, source: str, _stamp_ns: int) -> Array:
    raise PoseError(
        f"There is no transform from '{printable(source, 60)}' to '{printable(target, 60)}'.",
        ErrorCode.NO_TRANSFORM,
    )


class SceneSource:
    """Says where a part lies and what stands around it there.

    A support plane in the request takes the place of the default one; obstacles in the request
    come beside the default ones.

    Parameters
    ----------
    settings : callable
        Gives the node's settings at the moment of the call.
    check_mesh_id : callable
        Refuses a mesh ID that the catalogue does not have.
    uses_covariance : callable
        Whether covariances are looked at, at the moment of the call.
    transform : callable
        Takes a target frame, a source frame and a time [ns]; returns T_target_source (4, 4), or
        raises PoseError.
    arm_model : callable
        Name or file of the arm at the moment of the call; places have its frame then.
    """

    def __init__(
        self,
        settings: Callable[[], NodeSettings],
        check_mesh_id: Callable[[str], None],
        uses_covariance: Callable[[], bool] = lambda: True,
        transform: Transform = _no_transform,
        arm_model: Callable[[], str] = str,
    ) -> None:
        self._settings = settings
        self._uses_covariance = uses_covariance
        self._check_mesh_id = check_mesh_id
        self._transform = transform
        self._arm_model = arm_model

    def place(self, request: GraspRequest, pose: ObjectPose) -> Place:
        """The place of a part at a checked pose.

        Raises
        ------
        RequestError
            INVALID_SCENE.
        PoseError
            NO_TRANSFORM or TRANSFORM_STALE, for a frame that cannot be brought into the pose's.
        """
        T, covariance = pose.T_world_object.copy(), None
        origin = np.zeros(3)
        if np.abs(T[:3, 3]).max() > _NEAR_M:
            origin, T[:3, 3] = pose.T_world_object[:3, 3], 0.0
        data: dict[str, Any] = {}
        if (support := self._support(request.support_plane, pose)) is not None:
            normal, point = support[:3, 2], support[:3, 3] - origin
            # Of a plane far away: the point of it that is nearest to the part.
            foot = T[:3, 3] + normal * float(normal @ (point - T[:3, 3]))
            far = np.abs(point).max() > _NEAR_M
            data["support"] = {
                "name": SUPPORT,
                "point": (foot if far else point).tolist(),
                "normal": normal.tolist(),
            }
        obstacles = [
            *self._default_obstacles(pose, origin, T[:3, 3]),
            *(
                self._obstacle(obstacle, number, pose, origin)
                for number, obstacle in enumerate(request.obstacles)
            ),
        ]
        if obstacles:
            data["obstacles"] = obstacles
        if pose.covariance is not None and self._uses_covariance():
            covariance = covariance_in_object(pose.covariance, T[:3, :3])
        T_pose_arm = None
        if self._arm_model():
            T_pose_arm = self._arm_in(pose)
            T_pose_arm[:3, 3] -= origin
        around = Surroundings.from_mapping(data, self._stand_in)
        return Place(T, around, covariance, T_pose_arm)

    def palm_flange(self) -> Array | None:
        """The flange (4, 4) in the palm's frame: the arm's, or the parameter; None without either.

        Raises
        ------
        RequestError
            INVALID_SCENE, where the two contradict each other.
        """
        text, model = self._settings().palm_flange_pose, self._arm_model()
        given = None if text == NO_FLANGE else pose_of_text(text, "palm_flange_pose")
        if not model:
            return given
        of_arm = inverse(load_arm(model).T_flange_palm)
        if given is not None and not np.allclose(given, of_arm, atol=1e-6):
            raise _invalid(
                f"palm_flange_pose is '{text}', and the arm's file ({model}) has another flange. "
                "Leave palm_flange_pose at its default: with an arm its file says it."
            )
        return of_arm

    def _arm_in(self, pose: ObjectPose) -> Array:
        """The arm's frame (4, 4) in that of the part's pose."""
        frame_id = self._settings().arm_frame
        if not frame_id:
            raise _invalid(
                "An arm is set (arm.model), and arm_frame is empty. Set it to the frame in which "
                "the arm's file gives the pose of its base."
            )
        return np.array(self._into(pose, frame_id, "the parameter arm_frame"))

    def _support(self, message: PoseStamped, pose: ObjectPose) -> Array | None:
        """Pose (4, 4) of the support plane in the frame of the part's pose."""
        settings = self._settings()
        if message.header.frame_id:
            T = _pose_of(message, "the request's support_plane")
            return self._into(pose, message.header.frame_id, "the request's support_plane") @ T
        _check_untouched(message)  # else the default one would be taken in its place
        if settings.support_frame:
            T = pose_of_text(settings.support_pose, "support_pose")
            return self._into(pose, settings.support_frame, "the parameter support_frame") @ T
        return None

    def _default_obstacles(
        self, pose: ObjectPose, origin: Array, p_object: Array
    ) -> list[dict[str, Any]]:
        settings = self._settings()
        listed = obstacles_of(settings.obstacles)
        if not listed:
            return []
        T = self._into(pose, settings.obstacles_frame, "the parameter obstacles_frame")
        moved = [_moved(entry, T, origin) for entry in listed]
        return [e for e in moved if np.abs(e["position"] - p_object).max() <= _REACH_M]

    def _obstacle(
        self, message: Obstacle, number: int, pose: ObjectPose, origin: Array
    ) -> dict[str, Any]:
        name = printable(message.name, 60) or f"obstacle {number}"
        T = self._into(pose, message.pose.header.frame_id, f"the pose of '{name}'")
        entry: dict[str, Any] = _moved({"name": name, **_pose_entry(message.pose)}, T, origin)
        size = [message.size.x, message.size.y, message.size.z]
        if message.mesh_id:
            entry["mesh"] = message.mesh_id
        elif not any(size):
            raise _invalid(f"'{name}' has neither a size nor a mesh_id. Give one of them.")
        if any(size):
            entry["size"] = size
        return entry

    def _into(self, pose: ObjectPose, frame_id: str, what: str) -> Array:
        """Transform (4, 4) from a frame into that of the part's pose, at its time."""
        if frame_id == pose.frame_id:
            return np.eye(4)
        if not frame_id:
            raise _invalid(
                f"{what[0].upper()}{what[1:]} has no frame. Set its header.frame_id, such as to "
                f"'{printable(pose.frame_id, 60)}', that of the object's pose."
            )
        try:
            return self._transform(pose.frame_id, frame_id, pose.stamp_ns)
        except PoseError as error:
            raise PoseError(f"Of {what}: {error.message}", error.code) from error

    def _stand_in(self, mesh_id: str) -> TriangleMesh:
        """Check the ID alone: only the planning process reads the geometry."""
        try:
            self._check_mesh_id(mesh_id)
        except GraspPlannerError as error:
            raise _invalid(f"An obstacle's mesh: {error.message}") from error
        return STAND_IN


def _pose_entry(message: PoseStamped) -> dict[str, list[float]]:
    p, q = message.pose.position, message.pose.orientation
    return {"position": [p.x, p.y, p.z], "quat_xyzw": [q.x, q.y, q.z, q.w]}


def _pose_of(entry: PoseStamped | dict[str, Any], what: str) -> Array:
    fields = _pose_entry(entry) if isinstance(entry, PoseStamped) else entry
    T = read_pose({k: v for k, v in fields.items() if k == "quat_xyzw"}, what)
    T[:3, 3] = read_far_position(fields.get("position", (0.0, 0.0, 0.0)), what)
    return T


def _moved(entry: dict[str, Any], T_new_old: Array, origin: Array) -> dict[str, Any]:
    """An obstacle's entry in another frame, with its position counted from `origin`."""
    T = T_new_old @ _pose_of(entry, f"'{entry.get('name', 'an obstacle')!s:.60}'")
    position, quat_xyzw = to_position_quat_xyzw(T)
    return {**entry, "position": position - origin, "quat_xyzw": quat_xyzw}


def _check_untouched(message: PoseStamped) -> None:
    p, q = message.pose.position, message.pose.orientation
    if (p.x, p.y, p.z, q.x, q.y, q.z) != (0.0,) * 6 or q.w not in (0.0, 1.0):
        raise _invalid(
            "The request's support_plane has a pose and no frame. Set header.frame_id to the "
            "frame of the object's pose, or leave the whole of it out."
        )


def _invalid(message: str) -> RequestError:
    return RequestError(message, ErrorCode.INVALID_SCENE)
