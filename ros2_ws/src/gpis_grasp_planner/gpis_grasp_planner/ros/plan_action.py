"""The action plan_grasp: the same answer as the service's, with feedback and cancel."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from gpis_grasp_msgs.action import PlanGrasp
from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.ros.answering import GraspAnswering
from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.conversions import feedback_message
from gpis_grasp_planner.ros.request_reader import SERVICE_QOS
from gpis_grasp_planner.ros.settings import NodeSettings
from gpis_grasp_planner.ros.steady_timer import steady_timer
from gpis_grasp_planner.ros.text import printable

ACTION = "plan_grasp"
FEEDBACK_PERIOD_S = 0.1
# A result is kept so long for a client that has not asked for it yet.
RESULT_TIMEOUT_S = 60
_CANCELLING_S = 1.0
_PREEMPTED = "Preempted by a newer goal (parameter preempt_goals)."


class PlanGraspAction:
    """Offers plan_grasp as an action. A goal is never rejected: what is wrong is in its result.

    Parameters
    ----------
    node : Node
    answering : GraspAnswering
    settings : callable
        The node's settings at the moment of the call.
    """

    def __init__(
        self, node: Node, answering: GraspAnswering, settings: Callable[[], NodeSettings]
    ) -> None:
        self._answering = answering
        self._settings = settings
        self._log = node.get_logger()
        self._lock = threading.Lock()
        self._goals: dict[bytes, tuple[ServerGoalHandle, Call]] = {}
        self._server = ActionServer(
            node,
            PlanGrasp,
            ACTION,
            self._execute,
            callback_group=ReentrantCallbackGroup(),
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
            goal_service_qos_profile=SERVICE_QOS,
            result_service_qos_profile=SERVICE_QOS,
            cancel_service_qos_profile=SERVICE_QOS,
            result_timeout=RESULT_TIMEOUT_S,
        )
        self._feedback = steady_timer(
            node, FEEDBACK_PERIOD_S, self._give_feedback, ReentrantCallbackGroup()
        )

    def _on_accepted(self, goal: ServerGoalHandle) -> None:
        with self._lock:
            earlier = [call for _, call in self._goals.values()]
            self._goals[_key(goal)] = goal, Call()
            if self._feedback.is_canceled():
                self._feedback.reset()
        if self._settings().preempt_goals:
            for call in earlier:
                call.cancel(_PREEMPTED)
        goal.execute()

    def _on_cancel(self, goal: ServerGoalHandle) -> CancelResponse:
        with self._lock:
            _, call = self._goals.get(_key(goal), (None, None))
        if call is None:
            return CancelResponse.REJECT
        call.cancel("Cancelled by its client.")
        return CancelResponse.ACCEPT

    def _execute(self, goal: ServerGoalHandle) -> Any:
        with self._lock:
            _, call = self._goals[_key(goal)]
        result = PlanGrasp.Result()
        try:
            self._answering.answer(goal.request, result, call, f"goal {ACTION}")
        finally:
            with self._lock:
                del self._goals[_key(goal)]
        self._end(goal, call, result)
        return result

    def _end(self, goal: ServerGoalHandle, call: Call, result: Any) -> None:
        """Bring the goal into its last state."""
        cancelled = result.code == ErrorCode.CANCELLED and call.why_cancelled != _PREEMPTED
        # Its callback has told the call, and will tell the goal in a moment.
        deadline = time.monotonic() + _CANCELLING_S
        while cancelled and not goal.is_cancel_requested and time.monotonic() < deadline:
            time.sleep(0.002)
        try:
            if result.success:
                goal.succeed()
            elif cancelled and goal.is_cancel_requested:
                goal.canceled()
            else:
                goal.abort()
        except Exception as error:  # the context is gone
            self._log.warning(f"A goal's state was not sent: {printable(repr(error), 200)}")

    def _give_feedback(self) -> None:
        with self._lock:
            goals = list(self._goals.values())
            if not goals:  # it does not wake the executor until there is one
                self._feedback.cancel()
        for goal, call in goals:
            try:
                if goal.is_active:
                    goal.publish_feedback(feedback_message(call))
            except Exception as error:  # it ended meanwhile, or the context is gone
                self._log.debug(f"No feedback: {printable(repr(error), 200)}")


def _key(goal: ServerGoalHandle) -> bytes:
    return bytes(goal.goal_id.uuid)
