"""The services plan_grasp, and get_grasps: the same without a search."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from rclpy.node import Node

from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.ros.answering import GraspAnswering
from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.request_reader import RequestReader

SERVICE = "plan_grasp"
KNOWN_SERVICE = "get_grasps"
CLIENTS_PERIOD_S = 1.0


class PlanGraspService:
    """Offers both; a request that nobody is left to hear the answer of is given up.

    Parameters
    ----------
    node : Node
    answering : GraspAnswering
    threads : ThreadPoolExecutor
        With more threads than requests that can wait or be worked on.
    """

    def __init__(self, node: Node, answering: GraspAnswering, threads: ThreadPoolExecutor) -> None:
        self._node = node
        self._answering = answering
        self._lock = threading.Lock()
        self._calls: set[Call] = set()
        self._seen_alone = False
        RequestReader(node, PlanGrasp, SERVICE, self._plan, threads)
        RequestReader(node, PlanGrasp, KNOWN_SERVICE, self._known, threads)
        node.create_timer(CLIENTS_PERIOD_S, self._look_for_clients)

    def _plan(self, request: Any, response: Any) -> None:
        self._answer(request, response, SERVICE, only_known=False)

    def _known(self, request: Any, response: Any) -> None:
        self._answer(request, response, KNOWN_SERVICE, only_known=True)

    def _answer(self, request: Any, response: Any, name: str, *, only_known: bool) -> None:
        call = Call()
        with self._lock:
            self._calls.add(call)
        try:
            self._answering.answer(request, response, call, name, only_known=only_known)
        finally:
            with self._lock:
                self._calls.discard(call)

    def _look_for_clients(self) -> None:
        # The middleware does not say whose request this is, only whether any client is left.
        with self._lock:
            calls = list(self._calls)
        alone = bool(calls) and not any(map(self._node.count_clients, (SERVICE, KNOWN_SERVICE)))
        if alone and self._seen_alone:
            for call in calls:
                call.cancel("The client went away before its answer.")
        self._seen_alone = alone
