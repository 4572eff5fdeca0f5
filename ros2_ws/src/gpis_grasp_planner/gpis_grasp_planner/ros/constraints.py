"""What a request says about how the hand may come and what of the part it must not touch."""

from __future__ import annotations

import math

import numpy as np
from geometry_msgs.msg import Vector3Stamped

from gpis_grasp_msgs.msg import ForbiddenRegion as RegionMessage
from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.ros.grasp_request import GraspRequest
from gpis_grasp_planner.ros.request_guard import ObjectPose
from gpis_grasp_planner.ros.scene_source import Transform
from gpis_grasp_planner.ros.text import printable
from gpis_grasp_planner.surroundings.approach_cone import ApproachCone
from gpis_grasp_planner.surroundings.forbidden_region import ForbiddenRegion
from gpis_grasp_planner.surroundings.obstacles import read_pose


def approach_of(
    request: GraspRequest, pose: ObjectPose, transform: Transform
) -> ApproachCone | None:
    """The allowed approach directions, None where all are.

    Parameters
    ----------
    request : GraspRequest
    pose : ObjectPose
        Of the part; the cone is in its frame ("world"), or in the part's own.
    transform : callable
        As of `SceneSource`.

    Raises
    ------
    RequestError
        INVALID_SCENE.
    PoseError
        Of `transform`.
    """
    message, angle = request.approach_axis, request.approach_half_angle
    axis = np.array([message.vector.x, message.vector.y, message.vector.z])
    if angle == 0.0 and not _filled_in(message):
        return None
    if not 0.0 < angle <= math.pi:
        raise RequestError(
            f"The request's approach_half_angle is {angle:g} rad; with an approach_axis it must "
            "be above 0 and at most pi. Leave both out for no limit.",
            ErrorCode.INVALID_SCENE,
        )
    frame = message.header.frame_id
    if frame not in ("", pose.frame_id):
        axis = transform(pose.frame_id, frame, pose.stamp_ns)[:3, :3] @ axis
    return ApproachCone(axis, math.degrees(angle), "world" if frame else "object")


def forbidden_of(request: GraspRequest) -> tuple[ForbiddenRegion, ...]:
    """The regions of the part that must stay untouched.

    Raises
    ------
    RequestError
        INVALID_SCENE.
    """
    return tuple(_region(message, k) for k, message in enumerate(request.forbidden_regions))


def _region(message: RegionMessage, number: int) -> ForbiddenRegion:
    name = printable(message.name, 60) or f"forbidden region {number}"
    p, q = message.pose.position, message.pose.orientation
    entry = {"position": [p.x, p.y, p.z], "quat_xyzw": [q.x, q.y, q.z, q.w]}
    size = np.array([message.size.x, message.size.y, message.size.z])
    return ForbiddenRegion(read_pose(entry, f"'{name}'"), size, name, message.margin)


def _filled_in(message: Vector3Stamped) -> bool:
    v = message.vector
    return bool(message.header.frame_id) or (v.x, v.y, v.z) != (0.0, 0.0, 0.0)
