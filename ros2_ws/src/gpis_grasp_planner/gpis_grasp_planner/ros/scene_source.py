"""What stands around a part: from the request and the parameters, checked before any planning."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PoseStamped

from gpis_grasp_msgs.msg import Obstacle
from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError, RequestError
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.ros.request_guard import ObjectPose
from gpis_grasp_planner.ros.scene_defaults import obstacles_of, support_pose_of
from gpis_grasp_planner.ros.settings import NodeSettings
from gpis_grasp_planner.ros.text import printable
from gpis_grasp_planner.surroundings.covariance import covariance_in_object
from gpis_grasp_planner.surroundings.obstacles import Surroundings, read_pose
from gpis_grasp_planner.surroundings.place import STAND_IN, Place

SUPPORT = "support"


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
    """

    def __init__(
        self,
        settings: Callable[[], NodeSettings],
        check_mesh_id: Callable[[str], None],
        uses_covariance: Callable[[], bool] = lambda: True,
    ) -> None:
        self._settings = settings
        self._uses_covariance = uses_covariance
        self._check_mesh_id = check_mesh_id

    def place(self, request: PlanGrasp.Request, pose: ObjectPose) -> Place:
        """The place of a part at a checked pose.

        Raises
        ------
        RequestError
            INVALID_SCENE.
        """
        data: dict[str, Any] = {}
        if (plane := self._support(request.support_plane, pose.frame_id)) is not None:
            data["support"] = plane
        obstacles = [
            *self._default_obstacles(pose.frame_id),
            *(
                self._obstacle(obstacle, number, pose.frame_id)
                for number, obstacle in enumerate(request.obstacles)
            ),
        ]
        if obstacles:
            data["obstacles"] = obstacles
        T, covariance = pose.T_world_object, None
        if pose.covariance is not None and self._uses_covariance():
            covariance = covariance_in_object(pose.covariance, T[:3, :3])
        return Place(T, Surroundings.from_mapping(data, self._stand_in), covariance)

    def _support(self, message: PoseStamped, frame_id: str) -> dict[str, Any] | None:
        settings = self._settings()
        if message.header.frame_id:
            what = "the request's support_plane"
            _check_same_frame(message.header.frame_id, frame_id, what)
            T = read_pose(_pose_entry(message), what)
        elif settings.support_frame:
            _check_same_frame(settings.support_frame, frame_id, "the parameter support_frame")
            T = support_pose_of(settings.support_pose)
        else:
            _check_untouched(message)
            return None
        return {"name": SUPPORT, "point": T[:3, 3].tolist(), "normal": T[:3, 2].tolist()}

    def _default_obstacles(self, frame_id: str) -> list[dict[str, Any]]:
        settings = self._settings()
        listed = obstacles_of(settings.obstacles)
        if listed:
            _check_same_frame(settings.obstacles_frame, frame_id, "the parameter obstacles_frame")
        return listed

    def _obstacle(self, message: Obstacle, number: int, frame_id: str) -> dict[str, Any]:
        name = printable(message.name, 60) or f"obstacle {number}"
        _check_same_frame(message.pose.header.frame_id, frame_id, f"the pose of '{name}'")
        entry = {"name": name, **_pose_entry(message.pose)}
        size = [message.size.x, message.size.y, message.size.z]
        if message.mesh_id:
            entry["mesh"] = message.mesh_id
        elif not any(size):
            raise _invalid(f"'{name}' has neither a size nor a mesh_id. Give one of them.")
        if any(size):
            entry["size"] = size
        return entry

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


def _check_same_frame(frame_id: str, of_object: str, what: str) -> None:
    # Another frame would need tf, and a time; the node moves nothing between frames.
    if frame_id != of_object:
        raise _invalid(
            f"The frame of {what} is '{printable(frame_id, 40)}', that of the object's pose "
            f"'{printable(of_object, 40)}'; they must be the same. Transform the one into the "
            "other's frame before the call."
        )


def _check_untouched(message: PoseStamped) -> None:
    p, q = message.pose.position, message.pose.orientation
    if (p.x, p.y, p.z, q.x, q.y, q.z) != (0.0,) * 6 or q.w not in (0.0, 1.0):
        raise _invalid(
            "The request's support_plane has a pose and no frame. Set header.frame_id to the "
            "frame of the object's pose, or leave the whole of it out."
        )


def _invalid(message: str) -> RequestError:
    return RequestError(message, ErrorCode.INVALID_SCENE)
