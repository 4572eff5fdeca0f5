"""The last grasp follows its part."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.ros.settings import NodeSettings
from gpis_grasp_planner.ros.tracking import Tracking


class Answering:
    """Stands in for GraspAnswering."""

    def __init__(self) -> None:
        self.last_answered: Any = PlanGrasp.Request(mesh_id="mug")
        self.code = ErrorCode.SUCCESS
        self.asked: list[tuple[str, bool]] = []

    def answer(
        self, request: Any, response: Any, _call: Any, _name: str, *, only_known: bool, again: bool
    ) -> None:
        assert again
        self.asked.append((request.mesh_id, only_known))
        response.code = int(self.code)

    def forget(self, request: Any) -> None:
        assert request is self.last_answered
        self.last_answered = None


class Later(ThreadPoolExecutor):
    """Runs what it is given when told to."""

    def __init__(self) -> None:
        super().__init__(1)
        self.waiting: list[Any] = []

    def submit(self, function: Any, *arguments: Any) -> Any:  # type: ignore[override]
        self.waiting.append((function, arguments))

    def run(self) -> None:
        for function, arguments in self.waiting:
            function(*arguments)
        self.waiting = []


@pytest.mark.parametrize(("track", "mesh_id", "n"), [
    (True, "mug", 1), (True, None, 1), (True, "sphere", 0), (False, "mug", 0),
])  # fmt: skip
def test_estimates_of_the_part_are_answered_from_memory(
    track: bool, mesh_id: str | None, n: int
) -> None:
    answering, threads = Answering(), Later()
    tracking = Tracking(lambda: NodeSettings(track=track), answering, threads)  # type: ignore[arg-type]
    tracking.on_estimate(mesh_id)
    threads.run()
    assert answering.asked == [("mug", True)] * n


def test_one_answer_at_a_time_and_a_given_pose_is_not_tracked() -> None:
    answering, threads = Answering(), Later()
    tracking = Tracking(lambda: NodeSettings(track=True), answering, threads)  # type: ignore[arg-type]
    for _ in range(5):
        tracking.on_estimate("mug")
    assert len(threads.waiting) == 1
    threads.run()
    tracking.on_estimate("mug")
    assert len(threads.waiting) == 1
    threads.run()
    answering.last_answered.object_pose.header.frame_id = "cell"
    tracking.on_estimate("mug")
    assert threads.waiting == []


def test_what_is_forgotten_is_not_asked_for_again() -> None:
    answering, threads = Answering(), Later()
    tracking = Tracking(lambda: NodeSettings(track=True), answering, threads)  # type: ignore[arg-type]
    answering.code = ErrorCode.NOTHING_KNOWN
    tracking.on_estimate("mug")
    threads.run()
    tracking.on_estimate("mug")
    assert threads.waiting == []
