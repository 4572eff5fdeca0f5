"""A request in, an answer out, whatever happens; service and action both go through here."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rclpy.impl.rcutils_logger import RcutilsLogger

from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError, PoseError
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.ros.answer_log import log_info
from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.constraints import approach_of, forbidden_of
from gpis_grasp_planner.ros.conversions import (
    MeshVersion,
    funnel_messages,
    grasp_message,
    grasp_messages,
    pose_message,
)
from gpis_grasp_planner.ros.grasp_request import GraspRequest
from gpis_grasp_planner.ros.plan_source import DeliveredPlan, PlanSource
from gpis_grasp_planner.ros.pose_source import PoseSource
from gpis_grasp_planner.ros.publishers import GraspPublishers
from gpis_grasp_planner.ros.request_guard import ObjectPose, check_request
from gpis_grasp_planner.ros.scene_source import SceneSource, Transform
from gpis_grasp_planner.ros.settings import NodeSettings
from gpis_grasp_planner.ros.text import FRAME_PATTERN, printable

# A pose is taken anew where an answer took longer since it was looked up, or was searched for.
_NEWEST_FOR_S = 0.5
_MOST_RENEWALS = 3


class GraspAnswering:
    """Answers requests and publishes the best grasp. Thread-safe.

    Attributes
    ----------
    n_in_work : int
        Requests that are not answered yet.
    n_answers : int
    last_code, last_message
        Of the last answer.
    last_answered : GraspRequest or None
        The last request whose best grasp was published.
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
        transform: Transform,
    ) -> None:
        self._log = log
        self._hand = hand
        self._settings = settings
        self._poses = poses
        self._plans = plans
        self._publishers = publishers
        self._scenes = scenes
        self._transform = transform
        self._count_lock = threading.Lock()
        self._publish_lock = threading.Lock()
        self.n_in_work = 0
        self.n_answers = 0
        self.last_code = ErrorCode.SUCCESS
        self.last_message = ""
        self.last_answered: GraspRequest | None = None

    def admits(self, request: GraspRequest, response: Any, call: Call, name: str) -> bool:
        """Whether a request has to be looked at; else it is answered: it is wrong, or BUSY.

        For the thread that reads requests, of which a hundred may have come at once.

        Parameters
        ----------
        request, response, call, name
            As of :meth:`answer`.
        """
        try:
            self._plans.reserve(request.mesh_id, self._checked(request).seed, call)
        except GraspPlannerError as error:
            _fail(response, error.code, error.message)
            self._tell(request, response, call, name)
            return False
        except Exception:  # a thread meets it again, and answers
            return True
        return True

    def answer(
        self,
        request: GraspRequest,
        response: Any,
        call: Call,
        name: str,
        *,
        only_known: bool = False,
        again: bool = False,
    ) -> None:
        """Fill in a response; never raises.

        Parameters
        ----------
        request : PlanGrasp.Request or PlanGrasp.Goal
        response : PlanGrasp.Response or PlanGrasp.Result
        call : Call
        name : str
            Of the service or action, for the log.
        only_known : bool
            Answer from memory or not at all.
        again : bool
            Of the last answered request, for its part's next estimate. Nothing is published where
            another was answered meanwhile, and the log has a line where the code is another.
        """
        with self._count_lock:
            self.n_in_work += 1
        try:
            self._answer(request, response, call, only_known, again)
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
        finally:
            self._plans.release(call)
            with self._count_lock:
                self.n_in_work -= 1
        self._tell(request, response, call, name, again)

    def forget(self, request: GraspRequest) -> None:
        """It is not the last answered one any more, where it is that still."""
        with self._publish_lock:
            if self.last_answered is request:
                self.last_answered = None

    def _tell(
        self, request: GraspRequest, response: Any, call: Call, name: str, again: bool = False
    ) -> None:
        """Count an answer and log it."""
        response.elapsed = call.elapsed_s
        with self._count_lock:
            known = again and self.last_code == response.code
            self.n_answers += 1
            self.last_code = ErrorCode(response.code)
            self.last_message = response.message
        if known:  # at the rate of a camera it would fill the log
            return
        how = "from memory" if response.from_cache else f"{response.evaluations} evaluations"
        log_info(
            self._log,
            f"{name} '{printable(request.mesh_id, 64)}': {ErrorCode(response.code).name}, "
            f"{len(response.grasps)} grasps, {response.elapsed:.2f} s, {how}. "
            f"{printable(response.message, 400)}",
        )

    def _answer(
        self, request: GraspRequest, response: Any, call: Call, only_known: bool, again: bool
    ) -> None:
        plan_request = self._checked(request)
        self._plans.check_mesh_id(request.mesh_id)
        given = self._poses.from_request(request.object_pose)
        pose = given or self._poses.newest(request.mesh_id)
        # Before the plan: a bad scene, or a frame that nobody knows, is told at once.
        place = self._scenes.place(request, pose)
        shown = self._in_frame(pose, request.target_frame)
        plan_request = replace(
            plan_request,
            approach=approach_of(request, pose, self._transform),
            forbidden=forbidden_of(request),
        )
        T_palm_flange = self._scenes.palm_flange()
        version = MeshVersion(request.mesh_id)
        call.show = lambda grasp: grasp_message(grasp, version, shown, self._hand, T_palm_flange)
        ask = self._plans.known if only_known else self._plans.plan
        asked_s = call.elapsed_s
        delivered = ask(request.mesh_id, plan_request, call, place)
        took_s = call.elapsed_s - asked_s
        if given is None and (took_s > _NEWEST_FOR_S or not delivered.from_cache):
            pose, delivered = self._at_newest(request, plan_request, pose, delivered, call)
            shown = self._in_frame(pose, request.target_frame)
        plan = delivered.plan
        response.code = int(plan.code)
        response.message = plan.message
        if plan.code == ErrorCode.CANCELLED and call.cancelled:
            response.message = f"{call.why_cancelled} {plan.message}"
        response.evaluations = plan.evaluations
        response.objective = plan.objective
        response.funnel = funnel_messages(plan.funnel)
        response.from_cache = delivered.from_cache
        response.notes = [*plan.notes, *pose.notes]
        wanted = plan.grasps[: plan_request.n_grasps]
        response.grasps = grasp_messages(wanted, plan, shown, self._hand, T_palm_flange)
        if 0 < len(response.grasps) < len(plan.grasps):
            response.message += f" The first {len(response.grasps)} are answered, as asked."
        if plan.best_attempt is not None and not plan.grasps:
            attempt = grasp_message(plan.best_attempt, plan, shown, self._hand, T_palm_flange)
            response.best_attempt = [attempt]
        response.success = plan.code == ErrorCode.SUCCESS and bool(response.grasps)
        if response.success:
            self._publish(request, response.grasps, shown, again)

    def _at_newest(
        self,
        request: GraspRequest,
        plan_request: PlanRequest,
        pose: ObjectPose,
        delivered: DeliveredPlan,
        call: Call,
    ) -> tuple[ObjectPose, DeliveredPlan]:
        """What was made for `pose`, where the part is by now, and that pose.

        Where the place decides, that takes another turn, which may have to wait as well.
        """
        for _ in range(_MOST_RENEWALS):
            newest = self._newer(request.mesh_id, pose)
            if newest is pose:
                break
            pose, began_s = newest, call.elapsed_s
            place = self._scenes.place(request, pose)
            approach = approach_of(request, pose, self._transform)
            plan_request = replace(plan_request, approach=approach)
            if self._plans.depends(plan_request, place):
                delivered = self._plans.place(delivered, place, plan_request, call)
            if call.elapsed_s - began_s <= _NEWEST_FOR_S:
                break
        return pose, delivered

    def _publish(
        self, request: GraspRequest, grasps: list[Any], shown: ObjectPose, again: bool
    ) -> None:
        with self._publish_lock:
            if again and self.last_answered is not request:
                return
            self._publishers.publish(grasps, pose_message(shown.T_world_object))
            self.last_answered = request

    def _checked(self, request: GraspRequest) -> PlanRequest:
        return check_request(
            request.seed,
            request.time_budget,
            request.n_grasps,
            request.planner,
            request.verification,
            self._settings(),
            objective=request.objective,
            task=request.task,
        )

    def _in_frame(self, pose: ObjectPose, frame_id: str) -> ObjectPose:
        """The object's pose in the frame that the answer is wanted in; "" is its own."""
        if frame_id in ("", pose.frame_id):
            return pose
        if FRAME_PATTERN.fullmatch(frame_id) is None:
            raise PoseError(
                f"The target_frame is '{printable(frame_id, 60)}'; it must be 1 to 255 letters, "
                "digits or '_./~:-'.",
                ErrorCode.EMPTY_FRAME,
            )
        T_target_pose = self._transform(frame_id, pose.frame_id, pose.stamp_ns)
        return replace(pose, T_world_object=T_target_pose @ pose.T_world_object, frame_id=frame_id)

    def _newer(self, mesh_id: str, pose: ObjectPose) -> ObjectPose:
        """The estimate of now, where a good one came meanwhile; else `pose` itself."""
        try:
            newest = self._poses.newest(mesh_id)
        except PoseError as error:
            if error.code != ErrorCode.STALE_POSE:
                raise
            # It was fresh when the request came; that is what the limit promises.
            return pose
        return pose if newest.same_as(pose) else newest


def _fail(response: PlanGrasp.Response, code: ErrorCode, message: str) -> None:
    response.success = False
    response.code = int(code)
    response.message = message
    response.grasps = []
