"""Grasps in the forms of other packages, which are imported only when they are asked for.

``moveit_msgs/Grasp`` (also what ``grasping_msgs/GraspPlanning`` answers) and the YAML of
``isaac_grasp``. For programs that use the node's answers; the node itself needs none of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import yaml

from gpis_grasp_msgs.msg import Grasp
from gpis_grasp_planner.errors import RequestError

RETREAT_M = 0.1


def to_moveit(grasp: Grasp, identifier: str = "") -> Any:
    """``moveit_msgs/Grasp`` of a grasp.

    Its `grasp_pose` is the flange's (parameter `palm_flange_pose`): what MoveIt places is the
    link that the hand is mounted on. `grasp_quality` is epsilon.

    Raises
    ------
    RequestError
        If ``moveit_msgs`` or ``trajectory_msgs`` is not installed.
    """
    try:
        from moveit_msgs.msg import Grasp as MoveItGrasp
        from moveit_msgs.msg import GripperTranslation
        from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
    except ImportError as error:
        raise RequestError(
            f"The package {error.name} is not installed. Install ros-jazzy-moveit-msgs to have "
            "grasps in its form."
        ) from None

    def posture(joints: Any) -> Any:
        point = JointTrajectoryPoint(positions=list(joints.position))
        return JointTrajectory(header=joints.header, joint_names=list(joints.name), points=[point])

    def way(direction: Any, distance: float) -> Any:
        return GripperTranslation(
            direction=direction, desired_distance=distance, min_distance=0.5 * distance
        )

    return MoveItGrasp(
        id=identifier or f"{grasp.mesh_id} {grasp.mesh_hash[:8]}",
        pre_grasp_posture=posture(grasp.pre_grasp),
        grasp_posture=posture(grasp.grasp),
        grasp_pose=grasp.flange_pose,
        grasp_quality=grasp.epsilon,
        pre_grasp_approach=way(grasp.approach_direction, grasp.approach_distance),
        post_grasp_retreat=way(grasp.lift_direction, RETREAT_M),
        allowed_touch_objects=[grasp.mesh_id],
    )


def to_isaac_yaml(grasps: Sequence[Grasp], object_frame: str, gripper_frame: str) -> str:
    """Grasps as a file of format ``isaac_grasp`` 1.0.

    Parameters
    ----------
    grasps : sequence of Grasp
        Answered in the object's own frame: with an object pose of zero position and rotation.
    object_frame, gripper_frame : str
        Names of the frames there; the latter is the palm's.
    """
    return yaml.safe_dump(
        {
            "format": "isaac_grasp",
            "format_version": "1.0",
            "object_frame_link": object_frame,
            "gripper_frame_link": gripper_frame,
            "grasps": {f"grasp_{k}": _isaac_entry(grasp) for k, grasp in enumerate(grasps)},
        },
        sort_keys=False,
    )


def _isaac_entry(grasp: Grasp) -> dict[str, Any]:
    p, q = grasp.palm_pose.pose.position, grasp.palm_pose.pose.orientation
    return {
        "confidence": float(grasp.epsilon),
        "position": [p.x, p.y, p.z],
        "orientation": {"w": q.w, "xyz": [q.x, q.y, q.z]},
        "cspace_position": _joints(grasp.grasp),
        "pregrasp_cspace_position": _joints(grasp.pre_grasp),
    }


def _joints(state: Any) -> dict[str, float]:
    return dict(zip(state.name, map(float, state.position), strict=True))
