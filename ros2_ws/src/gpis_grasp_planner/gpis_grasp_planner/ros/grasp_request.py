"""What the service and the action have in common: the fields of a request."""

from __future__ import annotations

from typing import Protocol

from geometry_msgs.msg import PoseStamped, Vector3Stamped

from gpis_grasp_msgs.msg import ForbiddenRegion, Obstacle


class GraspRequest(Protocol):
    """The fields that ``PlanGrasp.Request`` and ``PlanGrasp.Goal`` have in common: all of them."""

    mesh_id: str
    object_pose: PoseStamped
    seed: int
    time_budget: float
    n_grasps: int
    planner: str
    verification: str
    objective: str
    task: str
    support_plane: PoseStamped
    obstacles: list[Obstacle]
    target_frame: str
    approach_axis: Vector3Stamped
    approach_half_angle: float
    forbidden_regions: list[ForbiddenRegion]
