"""Every bad input on the live node: its code, the figures in its message, the next good call."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile, QoSReliabilityPolicy

from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.errors import ErrorCode

NAN = math.nan
BAD_REQUESTS: dict[str, tuple[dict[str, Any], str, list[str]]] = {
    "unknown mesh": ({"mesh_id": "mugg"}, "UNKNOWN_MESH", ["mugg", "mug"]),
    "out of the catalogue": ({"mesh_id": "../mug"}, "INVALID_MESH_ID", ["../mug"]),
    "absolute": ({"mesh_id": "/etc/passwd"}, "INVALID_MESH_ID", ["letters"]),
    "encoded": ({"mesh_id": "%2e%2e%2fmug"}, "INVALID_MESH_ID", ["letters"]),
    "newline": ({"mesh_id": "mug\nmug"}, "INVALID_MESH_ID", ["\\n"]),
    "very long": ({"mesh_id": "m" * 5000}, "INVALID_MESH_ID", ["64"]),
    "no ID": ({"mesh_id": ""}, "INVALID_MESH_ID", ["letters"]),
    "link": ({"mesh_id": "link"}, "INVALID_MESH_ID", ["link"]),
    "pipe": ({"mesh_id": "pipe"}, "INVALID_MESH_ID", ["pipe"]),
    "empty mesh": ({"mesh_id": "empty"}, "MESH_EMPTY", ["empty"]),
    "truncated mesh": ({"mesh_id": "truncated"}, "MESH_UNREADABLE", ["truncated"]),
    "NaN in mesh": ({"mesh_id": "nan"}, "MESH_NOT_FINITE", ["nan"]),
    "millimetres": ({"mesh_id": "millimetres"}, "MESH_EXTENT_IMPLAUSIBLE", ["50", "mm"]),
    "nothing graspable": ({"mesh_id": "crate", "time_budget": 8.0}, "NO_FEASIBLE_GRASP", ["900"]),
    "empty frame": ({"pose": {"frame": ""}}, "EMPTY_FRAME", ["frame_id"]),
    "bad frame": ({"pose": {"frame": "a b"}}, "EMPTY_FRAME", ["'a b'"]),
    "NaN pose": ({"pose": {"xyz": (NAN, 0, 0)}}, "POSE_NOT_FINITE", ["nan"]),
    "infinite pose": ({"pose": {"xyzw": (0, 0, 0, math.inf)}}, "POSE_NOT_FINITE", ["inf"]),
    "zero quaternion": ({"pose": {"xyzw": (0, 0, 0, 0)}}, "INVALID_QUATERNION", ["norm 0"]),
    "long quaternion": (
        {"pose": {"xyzw": (0, 0, 0, 1.01)}},
        "INVALID_QUATERNION",
        ["1.01", "0.001"],
    ),
    "negative budget": ({"time_budget": -1.0}, "TIME_BUDGET_OUT_OF_RANGE", ["-1", "[0.1, 120]"]),
    "huge budget": ({"time_budget": 1e9}, "TIME_BUDGET_OUT_OF_RANGE", ["1e+09", "120"]),
    "NaN budget": ({"time_budget": NAN}, "TIME_BUDGET_OUT_OF_RANGE", ["nan", "120"]),
    "too many grasps": ({"n_grasps": 2**32 - 1}, "GRASP_COUNT_OUT_OF_RANGE", ["4294967295", "200"]),
    "unknown planner": ({"planner": "magic"}, "UNKNOWN_PLANNER", ["magic", "hpp"]),
    "negative seed": ({"seed": -2}, "INVALID_SETTING", ["-2"]),
}


@pytest.mark.parametrize("name", BAD_REQUESTS)
def test_bad_requests_are_answered_and_the_next_good_one_served(
    client: Any, planned: PlanGrasp.Response, parts: Path, tools: Any, name: str
) -> None:
    given, code, words = BAD_REQUESTS[name]
    fields = dict(given)
    if "pose" in fields:
        fields["object_pose"] = tools.pose(**fields.pop("pose"))
    response = client.plan(**fields)
    assert ErrorCode(response.code).name == code, response.message
    assert not response.success
    assert response.grasps == []
    for word in words:
        assert word in response.message
    assert str(parts) not in response.message
    assert "\n" not in response.message
    if code == "NO_FEASIBLE_GRASP":
        assert all(attempt.epsilon <= 0.0 for attempt in response.best_attempt)
    assert client.plan("mug").success


def test_no_estimate_then_good_then_bad_then_good(
    client: Any, planned: PlanGrasp.Response, tools: Any
) -> None:
    """The life of the topic object_pose, by a reliable and then a best-effort publisher."""

    def ask() -> PlanGrasp.Response:
        return client.plan("mug", object_pose=PoseStamped())

    response = ask()
    assert response.code == ErrorCode.NO_POSE_ESTIMATE
    assert "/object_pose" in response.message
    for frame, reliability in (
        ("camera", QoSReliabilityPolicy.RELIABLE),
        ("lidar", QoSReliabilityPolicy.BEST_EFFORT),
    ):
        publisher = client.node.create_publisher(
            PoseStamped, "object_pose", QoSProfile(depth=1, reliability=reliability)
        )
        tools.wait(lambda publisher=publisher: publisher.get_subscription_count() > 0, "the node")

        def answer_to(
            message: PoseStamped, code: ErrorCode, publisher: Any = publisher
        ) -> PlanGrasp.Response:
            """Publish until the node answers accordingly: best effort may lose a message."""
            last: list[PlanGrasp.Response] = []

            def published() -> bool:
                publisher.publish(message)
                last[:] = [ask()]
                frames = {grasp.palm_pose.header.frame_id for grasp in last[0].grasps}
                return last[0].code == code and frames <= {message.header.frame_id}

            tools.wait(published, f"code {code.name}")
            return last[0]

        good = answer_to(tools.stamped(client, 0.0, frame=frame, xyz=(0, 0, 1)), ErrorCode.SUCCESS)
        T_object_palm = np.linalg.inv(tools.matrix(tools.pose().pose)) @ tools.matrix(
            planned.grasps[0].palm_pose.pose
        )
        expected = tools.matrix(tools.pose(xyz=(0, 0, 1)).pose) @ T_object_palm
        assert np.allclose(tools.matrix(good.grasps[0].palm_pose.pose), expected, atol=1e-9)
        stale = answer_to(tools.stamped(client, 60.0), ErrorCode.STALE_POSE)
        assert f"limit is {tools.max_pose_age_s:g} s" in stale.message
        answer_to(tools.stamped(client, -60.0), ErrorCode.INVALID_STAMP)
        answer_to(tools.stamped(client, 0.0, xyz=(NAN, 0, 0)), ErrorCode.POSE_NOT_FINITE)
        answer_to(tools.stamped(client, 0.0, frame=""), ErrorCode.EMPTY_FRAME)
        answer_to(tools.stamped(client, 0.0, xyzw=(0, 0, 0, 0)), ErrorCode.INVALID_QUATERNION)
        answer_to(tools.stamped(client, 0.0), ErrorCode.SUCCESS)
        client.in_executor(client.node.destroy_publisher, publisher)
