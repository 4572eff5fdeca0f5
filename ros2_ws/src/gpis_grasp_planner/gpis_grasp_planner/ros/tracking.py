"""The last grasp, published anew wherever its part is seen next."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.ros.answering import GraspAnswering
from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.settings import NodeSettings


class Tracking:
    """Answers the last request again, from memory, when an estimate of its part has come.

    One answer at a time: estimates that come meanwhile are passed over, as the next answer takes
    the newest. A request that named the pose itself is not tracked.

    Parameters
    ----------
    settings : callable
        The node's settings at the moment of the call.
    answering : GraspAnswering
    threads : ThreadPoolExecutor
    """

    def __init__(
        self,
        settings: Callable[[], NodeSettings],
        answering: GraspAnswering,
        threads: ThreadPoolExecutor,
    ) -> None:
        self._settings = settings
        self._answering = answering
        self._threads = threads
        self._at_work = threading.Lock()

    def on_estimate(self, mesh_id: str | None) -> None:
        """Take notice of an estimate of a part, None for whichever part is in view."""
        request = self._answering.last_answered
        if request is None or not self._settings().track or request.object_pose.header.frame_id:
            return
        if mesh_id not in (None, request.mesh_id) or not self._at_work.acquire(blocking=False):
            return
        try:
            self._threads.submit(self._answer_again, request)
        except RuntimeError:  # the node ends
            self._at_work.release()

    def _answer_again(self, request: PlanGrasp.Request) -> None:
        response = PlanGrasp.Response()
        try:
            self._answering.answer(request, response, Call(), "track", only_known=True, again=True)
        finally:
            self._at_work.release()
        if response.code == ErrorCode.NOTHING_KNOWN:
            self._answering.forget(request)
