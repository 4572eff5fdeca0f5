"""A part that moves after its grasp was answered, and a goal that takes another's place: live."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionClient
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState

from gpis_grasp_msgs.action import PlanGrasp
from gpis_grasp_msgs.srv import PlanGrasp as PlanGraspService

LATCHED = QoSProfile(depth=50, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
QUARTER = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))


@pytest.fixture(scope="module")
def node(start_node: Callable[..., Any]) -> Iterator[Any]:
    started = start_node({"track": "true", "preempt_goals": "true", "planning_grace_s": "60.0"})
    started.wait_ready()
    yield started
    assert started.end() == 0, started.text()


def test_the_grasp_goes_with_the_part(node: Any, client: Any, tools: Any) -> None:
    estimates = client.node.create_publisher(PoseStamped, "object_pose", 1)
    palms: list[Any] = []
    joints: list[Any] = []
    heard = [
        client.node.create_subscription(PoseStamped, "palm_pose", palms.append, LATCHED),
        client.node.create_subscription(JointState, "grasp_joint_states", joints.append, LATCHED),
    ]

    def planned() -> bool:
        estimates.publish(tools.stamped(client, 0.0, frame="cell", xyz=(0.4, 0.1, 0.2)))
        request = PlanGraspService.Request(mesh_id="mug", time_budget=4.0)
        return bool(client.call(request).success)

    tools.wait(planned, "a grasp", 90.0)
    tools.wait(lambda: bool(palms and joints), "palm and joints")
    T_old = tools.matrix(tools.stamped(client, 0.0, xyz=(0.4, 0.1, 0.2)).pose)
    before, posture = tools.matrix(palms[-1].pose), list(joints[-1].position)

    for xyz, xyzw in (((0.1, -0.3, 0.2), QUARTER), ((0.5, 0.5, 0.7), (0.0, 0.0, 0.0, 1.0))):
        estimate = tools.stamped(client, 0.0, frame="cell", xyz=xyz, xyzw=xyzw)
        expected = tools.matrix(estimate.pose) @ np.linalg.inv(T_old) @ before

        def arrived(estimate: Any = estimate, expected: Any = expected) -> bool:
            estimate.header.stamp = client.node.get_clock().now().to_msg()
            estimates.publish(estimate)
            return bool(np.allclose(tools.matrix(palms[-1].pose), expected, atol=1e-6))

        tools.wait(arrived, "the palm where the part is now")
        assert palms[-1].header.frame_id == "cell"
        tools.wait(lambda: joints[-1].header.stamp == palms[-1].header.stamp, "its joints")
        assert list(joints[-1].position) == posture
    client.in_executor(client.node.destroy_publisher, estimates)
    for subscription in heard:
        client.in_executor(client.node.destroy_subscription, subscription)


def test_a_newer_goal_takes_the_place_of_the_one_at_work(
    node: Any, client: Any, tools: Any
) -> None:
    action = ActionClient(client.node, PlanGrasp, "plan_grasp")
    assert action.wait_for_server(90.0)
    told: list[Any] = []

    def send(seed: int, **fields: Any) -> Any:
        request = tools.request("mug", seed=seed, **fields)
        names = request.get_fields_and_field_types()
        goal = PlanGrasp.Goal(**{name: getattr(request, name) for name in names})
        sent = client.in_executor(action.send_goal_async, goal, lambda m: told.append((seed, m)))
        tools.wait(sent.done, "acceptance", 60.0)
        return client.in_executor(sent.result().get_result_async)

    first = send(1, time_budget=60.0)
    tools.wait(lambda: any(seed == 1 for seed, _ in told), "feedback", 60.0)
    second = send(2, time_budget=3.0)
    tools.wait(lambda: first.done() and second.done(), "both ends", 90.0)
    assert first.result().status == GoalStatus.STATUS_ABORTED
    assert first.result().result.message.startswith("Preempted by a newer goal")
    assert second.result().status == GoalStatus.STATUS_SUCCEEDED
    assert second.result().result.success
    client.in_executor(action.destroy)
