"""A request in, an answer out, whatever happens; service and action both go through here."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from typing import Any, Protocol

from geometry_msgs.msg import PoseStamped, Vector3Stamped
from rclpy.impl.rcutils_logger import RcutilsLogger

from gpis_grasp_msgs.msg import ForbiddenRegion, Obstacle
from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError, PoseError
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.conversions import grasp_message
from gpis_grasp_planner.ros.plan_source import PlanSource
from gpis_grasp_planner.ros.pose_source import PoseSource
from gpis_grasp_planner.ros.publishers import GraspPublishers
from gpis_grasp_planner.ros.request_guard import ObjectPose, check_request
from gpis_grasp_planner.ros.scene_source import SceneSource
from gpis_grasp_planner.ros.settings import NodeSettings
from gpis_grasp_planner.ros.text import printable


class GraspRequest(Protocol):
    """The fields that ``PlanGrasp.Request`` and ``PlanGrasp.Goal`` have in common: all of them."""

    mesh_id: str
    object_pose: PoseStamped
    seed: int
    time_budget: float
    n_grasps: int
    planner: str
    verification: str
    support_plane: PoseStamped
    obstacles: list[Obstacle]
    target_frame: str
    approach_axis: Vector3Stamped
    approach_half_angle: float
    forbidden_regions: list[ForbiddenRegion]


class GraspAnswering:
    """Answers requests and publishes the best grasp. Thread-safe.

    Attributes
    ----------
    n_in_work : int
        Requests that are not answered yet.
    n_answers : int
    last_code, last_message
        Of the last answer.
    """

    def __init__(
        self,
        log: RcutilsLogger,
        hand: HandDescription,
        settings: Callable[[], NodeSettings],
        poses: PoseSource,
        plans: PlanSource,
        publishers: GraspPublishers,
        scenes: SceneSource,
    ) -> None:
        self._log = log
        self._hand = hand
        self._settings = settings
        self._poses = poses
        self._plans = plans
        self._publishers = publishers
        self._scenes = scenes
        self._count_lock = threading.Lock()
        self.n_in_work = 0
        self.n_answers = 0
        self.last_code = ErrorCode.SUCCESS
        self.last_message = ""

    def answer(self, request: GraspRequest, response: Any, call: Call, name: str) -> None:
        """Fill in a response; never raises.

        Parameters
        ----------
        request : PlanGrasp.Request or PlanGrasp.Goal
        response : PlanGrasp.Response or PlanGrasp.Result
        call : Call
        name : str
            Of the service or action, for the log.
        """
        with self._count_lock:
            self.n_in_work += 1
        try:
            self._answer(request, response, call)
        except GraspPlannerError as error:
            _fail(response, error.code, error.message)
        except Exception as error:
            self._log.error(printable(traceback.format_exc(), 4000))
            _fail(
                response,
                ErrorCode.INTERNAL,
                f"The node failed unexpectedly ({type(error).__name__}). The traceback is in its "
                "log; please report it.",
            )
        response.elapsed = call.elapsed_s
        with self._count_lock:
            self.n_in_work -= 1
            self.n_answers += 1
            self.last_code = ErrorCode(response.code)
            self.last_message = response.message
        how = "from memory" if response.from_cache else f"{response.evaluations} evaluations"
        self._log.info(
            f"{name} '{printable(request.mesh_id, 64)}': {ErrorCode(response.code).name}, "
            f"{len(response.grasps)} grasps, {response.elapsed:.2f} s, {how}. "
            f"{printable(response.message, 400)}"
        )

    def _answer(self, request: GraspRequest, response: Any, call: Call) -> None:
        plan_request = check_request(
            request.seed,
            request.time_budget,
            request.n_grasps,
            request.planner,
            request.verification,
            self._settings(),
        )
        self._plans.check_mesh_id(request.mesh_id)
        given = self._poses.from_request(request.object_pose)
        pose = given or self._poses.newest(request.mesh_id)
        place = self._scenes.place(request, pose)  # before the plan: a bad scene is told at once
        delivered = self._plans.plan(request.mesh_id, plan_request, call, place)
        if given is None and not delivered.from_cache:
            pose, planned_for = self._newer(request.mesh_id, pose), pose
            if place and pose is not planned_for:
                place = self._scenes.place(request, pose)
                delivered = self._plans.place(delivered, place, plan_request, call)
        plan = delivered.plan
        response.code = int(plan.code)
        response.message = plan.message
        response.evaluations = plan.evaluations
        response.from_cache = delivered.from_cache
        response.notes = [*plan.notes, *pose.notes]
        response.grasps = [
            grasp_message(grasp, plan, pose, self._hand)
            for grasp in plan.grasps[: plan_request.n_grasps]
        ]
        if plan.best_attempt is not None and not plan.grasps:
            attempt = grasp_message(plan.best_attempt, plan, pose, self._hand)
            response.best_attempt = [attempt]
        response.success = plan.code == ErrorCode.SUCCESS and bool(response.grasps)
        if response.success:
            self._publishers.publish(response.grasps[0])

    def _newer(self, mesh_id: str, pose: ObjectPose) -> ObjectPose:
        """The estimate of now, where a good one came while the plan was made."""
        try:
            return self._poses.newest(mesh_id)
        except PoseError as error:
            if error.code != ErrorCode.STALE_POSE:
                raise
            # It was fresh when the request came; that is what the limit promises.
            return pose


def _fail(response: PlanGrasp.Response, code: ErrorCode, message: str) -> None:
    response.success = False
    response.code = int(code)
    response.message = message
    response.grasps = []
