"""The action over real DDS: results, feedback, cancel, several goals; and frames by tf."""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import TransformStamped
from rclpy.action import ActionClient
from rclpy.duration import Duration
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

from gpis_grasp_msgs.action import PlanGrasp
from gpis_grasp_planner.errors import ErrorCode

HALF = math.sqrt(0.5)
PHASES = {"waiting", "reading", "preparing", "searching", "trying", "placing"}


class Goal:
    """One goal, its feedback with times of arrival, and its end."""

    def __init__(self, actions: Actions, fields: dict[str, Any]) -> None:
        request = actions.tools.request(**fields)
        values = {name: getattr(request, name) for name in request.get_fields_and_field_types()}
        self.feedback: list[tuple[float, Any]] = []
        self.done = threading.Event()
        self.accepted = threading.Event()
        self.handle: Any = None
        self.answer: Any = None
        self._in_executor = actions.in_executor
        sent = self._in_executor(
            actions.client.send_goal_async,
            PlanGrasp.Goal(**values),
            lambda m: self.feedback.append((time.monotonic(), m.feedback)),
        )
        sent.add_done_callback(self._on_accepted)

    def _on_accepted(self, future: Any) -> None:
        self.handle = future.result()
        assert self.handle.accepted
        self.accepted.set()
        self.handle.get_result_async().add_done_callback(self._on_result)

    def _on_result(self, future: Any) -> None:
        self.answer = future.result()
        self.done.set()

    def result(self) -> tuple[int, Any]:
        assert self.done.wait(120.0)
        return self.answer.status, self.answer.result

    def cancel(self) -> None:
        assert self.accepted.wait(60.0)
        self._in_executor(self.handle.cancel_goal_async)


class Actions:
    def __init__(self, client: Any, tools: Any) -> None:
        self.client = ActionClient(client.node, PlanGrasp, "plan_grasp")
        self.in_executor = client.in_executor
        self.tools = tools
        assert self.client.wait_for_server(90.0)

    def send(self, mesh_id: str = "mug", **fields: Any) -> Goal:
        return Goal(self, {"mesh_id": mesh_id, **fields})


@pytest.fixture(scope="module")
def actions(node: Any, client: Any, tools: Any) -> Iterator[Actions]:
    made = Actions(client, tools)
    yield made
    client.in_executor(made.client.destroy)


def test_a_goal_has_the_services_answer(actions: Actions, client: Any, planned: Any) -> None:
    status, result = actions.send("mug").result()
    assert status == GoalStatus.STATUS_SUCCEEDED
    assert result.from_cache
    served = client.plan("mug").grasps
    for one, other in zip(result.grasps, served, strict=True):  # but for the stamps of arrival
        assert one.palm_pose.pose == other.palm_pose.pose
        assert one.grasp.position == other.grasp.position
        assert one.contacts == other.contacts


def test_feedback_comes_in_every_phase(actions: Actions) -> None:
    goal = actions.send("sphere", time_budget=3.0, seed=31, verification="rank")
    status, result = goal.result()
    assert status == GoalStatus.STATUS_SUCCEEDED, result.message
    phases = [feedback.phase for _, feedback in goal.feedback]
    assert set(phases) <= PHASES
    assert {"searching", "trying"} & set(phases)
    shares = [feedback.share_done for _, feedback in goal.feedback]
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] <= shares[-1] <= 1.0
    assert max(feedback.evaluations for _, feedback in goal.feedback) <= result.evaluations
    assert len(goal.feedback) >= 5 * result.elapsed - 5
    shown = [grasp for _, feedback in goal.feedback for grasp in feedback.best_verified]
    for _, feedback in goal.feedback:
        assert len(feedback.best_verified) == (feedback.n_held > 0)
    for grasp in shown:
        assert grasp.mesh_id == "sphere"
        assert grasp.epsilon > 0.0
        assert grasp.palm_pose.header.frame_id == "world"


def test_what_is_wrong_is_in_the_result(actions: Actions) -> None:
    status, result = actions.send("mugg").result()
    assert status == GoalStatus.STATUS_ABORTED
    assert result.code == ErrorCode.UNKNOWN_MESH
    assert "mug" in result.message


def test_a_cancelled_goal_ends_and_the_next_one_succeeds(actions: Actions, tools: Any) -> None:
    goal = actions.send("sphere", time_budget=60.0, seed=32)
    tools.wait(lambda: any(f.phase == "searching" for _, f in goal.feedback), "the search", 60.0)
    goal.cancel()
    status, result = goal.result()
    assert status == GoalStatus.STATUS_CANCELED
    assert result.code == ErrorCode.CANCELLED
    assert not result.success
    status, result = actions.send("sphere", time_budget=1.0, seed=33).result()
    assert status == GoalStatus.STATUS_SUCCEEDED, result.message


def test_goals_wait_in_the_queue_and_one_that_waits_can_be_cancelled(
    actions: Actions, tools: Any
) -> None:
    first = actions.send("sphere", time_budget=60.0, seed=34)
    tools.wait(lambda: any(f.phase == "searching" for _, f in first.feedback), "the search", 60.0)
    second = actions.send("sphere", time_budget=1.0, seed=35)
    tools.wait(lambda: any(f.phase == "waiting" for _, f in second.feedback), "the queue")
    _, third = actions.send("sphere", time_budget=1.0, seed=36).result()  # queue_size is 1
    assert third.code == ErrorCode.BUSY
    second.cancel()
    assert second.result()[0] == GoalStatus.STATUS_CANCELED
    assert not first.done.is_set()
    first.cancel()
    assert first.result()[0] == GoalStatus.STATUS_CANCELED


def test_any_number_of_calls_at_once_is_answered(client: Any, planned: Any, tools: Any) -> None:
    """Each with its plan or BUSY; more than ten were lost in the readers' queues before."""
    requests = [tools.request("mug") for _ in range(60)]
    requests += [tools.request("sphere", seed=1000 + k, time_budget=0.5) for k in range(60)]
    calls = [client.call_async(request) for request in requests]
    tools.wait(lambda: all(call.done() for call in calls), "120 answers", 120.0)
    answers = [call.result() for call in calls]
    assert all(answer.from_cache for answer in answers[:60])
    codes = {answer.code for answer in answers[60:]}
    assert codes <= {int(ErrorCode.SUCCESS), int(ErrorCode.BUSY)}
    assert len(codes) == 2


class Frames:
    """Publishes transforms as a robot does."""

    def __init__(self, node: Any) -> None:
        self._node = node
        late = QoSProfile(depth=10, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        self._moving = node.create_publisher(TFMessage, "/tf", 10)
        self._static = node.create_publisher(TFMessage, "/tf_static", late)

    def put(self, parent: str, child: str, xyz: Any, quat: Any, stamp: Any = None) -> None:
        message = TransformStamped(child_frame_id=child)
        message.header.frame_id = parent
        t, r = message.transform.translation, message.transform.rotation
        t.x, t.y, t.z = map(float, xyz)
        r.x, r.y, r.z, r.w = map(float, quat)
        if stamp is not None:
            message.header.stamp = stamp
        (self._static if stamp is None else self._moving).publish(TFMessage(transforms=[message]))


def test_an_estimate_in_a_moving_cameras_frame_is_answered_in_the_bases(
    client: Any, planned: Any, tools: Any
) -> None:
    frames = Frames(client.node)
    frames.put("base", "arm", (0, 0, 1), (0, 0, 0, 1))
    rounds = itertools.count()
    estimate = tools.pose(xyz=(0.2, 0.0, 0.3))

    def answer() -> Any:
        now = client.node.get_clock().now()
        camera = f"camera_{next(rounds)}"  # where the one before has been is nobody's business
        estimate.header.frame_id = camera
        for age_s, xyz in ((1.4, (1, 0, 0)), (0.2, (3, 0, 0)), (0.0, (9, 9, 9))):
            stamp = (now - Duration(seconds=age_s)).to_msg()
            frames.put("arm", camera, xyz, (HALF, 0, 0, HALF), stamp)
        estimate.header.stamp = (now - Duration(seconds=0.8)).to_msg()
        return client.plan("mug", object_pose=estimate, target_frame="base")

    answers: list[Any] = []

    def answered() -> bool:
        answers.append(answer())
        return bool(answers[-1].success)

    tools.wait(answered, "the transforms", 60.0)
    response = answers[-1]
    T_base_camera = tools.matrix(tools.pose(xyz=(2, 0, 1), xyzw=(HALF, 0, 0, HALF)).pose)
    T_base_object = T_base_camera @ tools.matrix(estimate.pose)
    T_world_object = tools.matrix(tools.pose().pose)
    for here, there in zip(planned.grasps, response.grasps, strict=True):
        assert there.palm_pose.header.frame_id == "base"
        assert there.palm_pose.header.stamp == estimate.header.stamp
        T_object_palm = np.linalg.inv(T_world_object) @ tools.matrix(here.palm_pose.pose)
        got = tools.matrix(there.palm_pose.pose)
        # Half of the way: exact but for the nanoseconds of a stamp.
        np.testing.assert_allclose(got, T_base_object @ T_object_palm, atol=1e-6)


@pytest.mark.parametrize(
    ("frame", "age_s", "code"),
    [("nowhere", 0.1, ErrorCode.NO_TRANSFORM), ("camera", 2.5, ErrorCode.TRANSFORM_STALE)],
)
def test_what_tf_does_not_know_is_told_at_once(
    client: Any, planned: Any, tools: Any, frame: str, age_s: float, code: ErrorCode
) -> None:
    frames = Frames(client.node)
    frames.put("arm", "camera", (1, 0, 0), (0, 0, 0, 1), tools.stamped(client, 0.0).header.stamp)
    estimate = tools.stamped(client, age_s, frame=frame)

    def answered() -> bool:
        frames.put(
            "arm", "camera", (1, 0, 0), (0, 0, 0, 1), tools.stamped(client, 0.0).header.stamp
        )
        return bool(client.plan("mug", object_pose=estimate, target_frame="base").code == code)

    tools.wait(answered, code.name)
