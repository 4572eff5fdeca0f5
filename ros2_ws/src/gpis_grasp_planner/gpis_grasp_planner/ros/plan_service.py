"""The service plan_grasp: a request in, an answer out, whatever happens."""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError, PoseError
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.ros.conversions import grasp_message
from gpis_grasp_planner.ros.plan_supply import PlanSupply
from gpis_grasp_planner.ros.pose_source import PoseSource
from gpis_grasp_planner.ros.publishers import GraspPublishers
from gpis_grasp_planner.ros.request_guard import ObjectPose, check_request
from gpis_grasp_planner.ros.scene_source import SceneSource
from gpis_grasp_planner.ros.settings import NodeSettings
from gpis_grasp_planner.ros.text import printable

SERVICE = "plan_grasp"


class PlanGraspService:
    """Answers plan_grasp and publishes the best grasp. `last_code` is that of the last answer."""

    def __init__(
        self,
        node: Node,
        hand: HandDescription,
        settings: Callable[[], NodeSettings],
        poses: PoseSource,
        supply: PlanSupply,
        publishers: GraspPublishers,
        scenes: SceneSource,
    ) -> None:
        self._log = node.get_logger()
        self._hand = hand
        self._settings = settings
        self._poses = poses
        self._supply = supply
        self._publishers = publishers
        self._scenes = scenes
        self._count_lock = threading.Lock()
        self.n_in_work = 0
        self.n_answers = 0
        self.last_code = ErrorCode.SUCCESS
        self.last_message = ""
        node.create_service(
            PlanGrasp, SERVICE, self._on_request, callback_group=ReentrantCallbackGroup()
        )

    def _on_request(
        self, request: PlanGrasp.Request, response: PlanGrasp.Response
    ) -> PlanGrasp.Response:
        # An exception that left this callback would end the node while the client waits for ever.
        start = time.monotonic()
        self._count(1)
        try:
            self._answer(request, response)
        except GraspPlannerError as error:
            _fail(response, error.code, error.message)
        except Exception as error:
            self._log.error(printable(traceback.format_exc(), 4000))
            _fail(
                response,
                ErrorCode.INTERNAL,
                f"The node failed unexpectedly ({type(error).__name__}: {error}). The traceback "
                "is in its log; please report it.",
            )
        response.elapsed = time.monotonic() - start
        self.last_code = ErrorCode(response.code)
        self.last_message = response.message
        how = "from memory" if response.from_cache else f"{response.evaluations} evaluations"
        self._log.info(
            f"plan_grasp '{printable(request.mesh_id, 64)}': {self.last_code.name}, "
            f"{len(response.grasps)} grasps, {response.elapsed:.2f} s, {how}. "
            f"{printable(response.message, 400)}"
        )
        self._count(-1)
        return response

    def _count(self, change: int) -> None:
        with self._count_lock:
            self.n_in_work += change
            self.n_answers += change < 0

    def _answer(self, request: PlanGrasp.Request, response: PlanGrasp.Response) -> None:
        plan_request = check_request(
            request.seed,
            request.time_budget,
            request.n_grasps,
            request.planner,
            request.verification,
            self._settings(),
        )
        self._supply.check_mesh_id(request.mesh_id)
        given = self._poses.from_request(request.object_pose)
        pose = given or self._poses.newest(request.mesh_id)
        place = self._scenes.place(request, pose)  # before the plan: a bad scene is told at once
        supplied = self._supply.plan(request.mesh_id, plan_request, place)
        if given is None and not supplied.from_cache:
            pose, planned_for = self._newer(request.mesh_id, pose), pose
            if place and pose is not planned_for:
                place = self._scenes.place(request, pose)
                supplied = self._supply.place(supplied, place, plan_request)
        plan = supplied.plan
        response.code = int(plan.code)
        response.message = plan.message
        response.evaluations = plan.evaluations
        response.from_cache = supplied.from_cache
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
