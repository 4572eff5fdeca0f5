"""Goals and their calls, on a real server that nobody calls: preemption, cancel, last states."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from rclpy.action import CancelResponse
from rclpy.node import Node
from real_node import plain_node

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.ros import plan_action
from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.plan_action import PlanGraspAction
from gpis_grasp_planner.ros.settings import NodeSettings


class Goal:
    """Stands in for ServerGoalHandle."""

    def __init__(self, number: int) -> None:
        self.goal_id = SimpleNamespace(uuid=[number] * 16)
        self.request = SimpleNamespace(mesh_id="mug")
        self.is_cancel_requested = False
        self.is_active = True
        self.state = ""
        self.feedback: list[Any] = []

    def execute(self) -> None:
        self.state = "executing"

    def succeed(self) -> None:
        self.state = "succeeded"

    def abort(self) -> None:
        self.state = "aborted"

    def canceled(self) -> None:
        assert self.is_cancel_requested
        self.state = "canceled"

    def publish_feedback(self, feedback: Any) -> None:
        self.feedback.append(feedback)


class Answering:
    """Answers with a code, or as the call says."""

    def __init__(self) -> None:
        self.code = ErrorCode.SUCCESS
        self.calls: list[Call] = []

    def answer(self, _request: Any, response: Any, call: Call, _name: str) -> None:
        self.calls.append(call)
        response.code = int(ErrorCode.CANCELLED if call.cancelled else self.code)
        response.success = response.code == 0
        try:
            call.check_wanted()
        except Exception as error:
            response.message = str(error)


@pytest.fixture(scope="module")
def node() -> Iterator[Node]:
    with plain_node("goals") as made:
        yield made


@pytest.fixture
def answering() -> Answering:
    return Answering()


class Actions:
    """Makes the action on a node, and takes its server away."""

    def __init__(self, node: Node, answering: Answering) -> None:
        self._node, self._answering = node, answering
        self._made: list[PlanGraspAction] = []

    def __call__(self, *, preempt: bool = False) -> PlanGraspAction:
        settings = NodeSettings(preempt_goals=preempt)
        self._made.append(PlanGraspAction(self._node, self._answering, lambda: settings))  # type: ignore[arg-type]
        return self._made[-1]

    def destroy(self) -> None:
        for made in self._made:
            made._server.destroy()
            self._node.destroy_timer(made._feedback)


@pytest.fixture
def action(monkeypatch: pytest.MonkeyPatch, node: Node, answering: Answering) -> Iterator[Actions]:
    monkeypatch.setattr(plan_action, "_CANCELLING_S", 0.0)
    actions = Actions(node, answering)
    yield actions
    actions.destroy()


@pytest.mark.parametrize(
    ("code", "state"),
    [(ErrorCode.SUCCESS, "succeeded"), (ErrorCode.BUSY, "aborted")],
)
def test_the_last_state_says_how_it_went(
    action: Actions, answering: Answering, code: ErrorCode, state: str
) -> None:
    made, goal = action(), Goal(1)
    answering.code = code
    made._on_accepted(goal)
    assert goal.state == "executing"
    assert made._execute(goal).code == code
    assert goal.state == state


def test_a_cancelled_goal_is_canceled_and_an_ended_one_cannot_be(action: Actions) -> None:
    made, goal = action(), Goal(1)
    made._on_accepted(goal)
    assert made._on_cancel(goal) == CancelResponse.ACCEPT
    goal.is_cancel_requested = True
    assert made._execute(goal).message == "Cancelled by its client."
    assert goal.state == "canceled"
    assert made._on_cancel(goal) == CancelResponse.REJECT


@pytest.mark.parametrize("preempt", [False, True])
def test_a_newer_goal_preempts_where_that_is_wanted(action: Actions, preempt: bool) -> None:
    made, first, second = action(preempt=preempt), Goal(1), Goal(2)
    made._on_accepted(first)
    made._on_accepted(second)
    results = [made._execute(goal) for goal in (first, second)]
    assert [goal.state for goal in (first, second)] == [
        "aborted" if preempt else "succeeded",
        "succeeded",
    ]
    assert ("Preempted" in results[0].message) == preempt


def test_feedback_goes_to_active_goals_alone(action: Actions) -> None:
    made, active, ended = action(), Goal(1), Goal(2)
    for goal in (active, ended):
        made._on_accepted(goal)
    ended.is_active = False
    made._give_feedback()
    assert [feedback.phase for feedback in active.feedback] == ["waiting"]
    assert ended.feedback == []


def test_the_feedback_timer_rests_while_there_is_no_goal(action: Actions) -> None:
    made, goal = action(), Goal(1)
    made._give_feedback()
    assert made._feedback.is_canceled()
    made._on_accepted(goal)
    assert not made._feedback.is_canceled()
    made._give_feedback()
    assert not made._feedback.is_canceled()
    made._execute(goal)
    made._give_feedback()
    assert made._feedback.is_canceled()
    assert len(goal.feedback) == 1
