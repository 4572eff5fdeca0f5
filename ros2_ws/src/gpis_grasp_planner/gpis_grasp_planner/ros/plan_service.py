"""The services plan_grasp, and get_grasps: the same without a search."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from rclpy.node import Node

from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.ros.answering import GraspAnswering
from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.request_reader import RequestReader, Work, later
from gpis_grasp_planner.ros.steady_timer import steady_timer

SERVICE = "plan_grasp"
KNOWN_SERVICE = "get_grasps"
CLIENTS_PERIOD_S = 1.0


class ClientWatch:
    """Cancels calls that nobody is left to hear the answers of.

    The middleware does not say whose request one is, only how many clients there are, and it may
    learn of a client later than of its request. So a call is cancelled where clients were seen
    while it was in work, and then none in two looks.

    Parameters
    ----------
    count_clients : callable
        How many clients there are now.
    """

    def __init__(self, count_clients: Callable[[], int]) -> None:
        self._count_clients = count_clients
        self._lock = threading.Lock()
        self._seen: dict[Call, bool] = {}
        self._was_alone = False

    @contextmanager
    def watched(self, call: Call) -> Iterator[None]:
        """Watch a call while it is in work."""
        with self._lock:
            self._seen[call] = False
        try:
            yield
        finally:
            with self._lock:
                del self._seen[call]

    def look(self) -> None:
        """Count clients; for a timer."""
        with self._lock:
            if not self._seen:
                self._was_alone = False
                return
            alone = self._count_clients() == 0
            if not alone:
                self._seen = dict.fromkeys(self._seen, True)
            gone = [call for call, seen in self._seen.items() if seen and self._was_alone and alone]
            self._was_alone = alone
        for call in gone:
            call.cancel("The client went away before its answer.")


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
        # Under the names they have after remapping, which counting does not do.
        names = [node.resolve_service_name(name) for name in (SERVICE, KNOWN_SERVICE)]
        self._watch = ClientWatch(lambda: sum(map(node.count_clients, names)))
        requests.offer(PlanGrasp, SERVICE, self._begin)
        requests.offer(PlanGrasp, KNOWN_SERVICE, later(self._known))
        steady_timer(node, CLIENTS_PERIOD_S, self._watch.look)

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
