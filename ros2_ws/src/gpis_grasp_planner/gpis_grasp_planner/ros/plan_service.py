"""The services plan_grasp, and get_grasps: the same without a search."""

from __future__ import annotations

from functools import partial
from typing import Any

from rclpy.node import Node

from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.ros.answering import GraspAnswering
from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.client_watch import watch_clients
from gpis_grasp_planner.ros.request_reader import RequestReader, Work, later

SERVICE = "plan_grasp"
KNOWN_SERVICE = "get_grasps"


class PlanGraspService:
    """Offers both services.

    Parameters
    ----------
    node : Node
    answering : GraspAnswering
    requests : RequestReader
        With more threads than requests that can wait or be worked on.
    """

    def __init__(self, node: Node, answering: GraspAnswering, requests: RequestReader) -> None:
        self._answering = answering
        self._watch = watch_clients(node, SERVICE, KNOWN_SERVICE)
        requests.offer(PlanGrasp, SERVICE, self._begin)
        requests.offer(PlanGrasp, KNOWN_SERVICE, later(self._known))

    def _begin(self, request: Any, response: Any) -> Work | None:
        call = Call()
        if not self._answering.admits(request, response, call, SERVICE):
            return None
        return partial(self._plan, request, response, call)

    def _plan(self, request: Any, response: Any, call: Call) -> None:
        with self._watch.watched(call):
            self._answering.answer(request, response, call, SERVICE)

    def _known(self, request: Any, response: Any) -> None:
        call = Call()
        with self._watch.watched(call):
            self._answering.answer(request, response, call, KNOWN_SERVICE, only_known=True)
