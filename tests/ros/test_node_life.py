"""Start, parameters and end of the node."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovariance, PoseWithCovarianceStamped
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.ros.parameter_groups import parameter_infos

Start = Callable[..., Any]


def gone(pid: int, seconds: float = 30.0) -> bool:
    """Whether a process disappears in time."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        stat = Path(f"/proc/{pid}/stat")
        if not stat.exists() or ") Z " in stat.read_text():
            return True
        time.sleep(0.05)
    return False


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_while_planning_answers_ends_with_0_and_leaves_no_child(
    start_node: Start, client: Any, tools: Any, number: signal.Signals
) -> None:
    node = start_node({"planning_grace_s": "60.0"})
    node.wait_ready()
    worker = node.wait_worker()
    future = client.call_async(tools.request("sphere", time_budget=30.0))
    time.sleep(1.0)
    assert node.end(number) == 0, node.text()
    tools.wait(future.done, "the answer")
    assert future.result().code == ErrorCode.SHUTTING_DOWN
    assert gone(worker)
    assert "Traceback" not in node.text()


def test_a_signal_with_many_requests_in_work_destroys_nothing_in_use(
    start_node: Start, client: Any, tools: Any
) -> None:
    node = start_node({"queue_size": "4"})
    node.wait_ready()
    futures = [client.call_async(tools.request("mug", time_budget=5.0)) for _ in range(40)]
    tools.wait(lambda: any(future.done() for future in futures), "a first BUSY")
    assert node.end() == 0, node.text()
    codes = {future.result().code for future in futures if future.done()}
    assert codes <= {ErrorCode.BUSY, ErrorCode.SHUTTING_DOWN}
    for word in ("Traceback", "Destroyable", "InvalidHandle", "was never awaited"):
        assert word not in node.text(), node.text()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_during_the_imports_ends_with_0(number: signal.Signals) -> None:
    """From the first line of `main` on; the interpreter's own start cannot be guarded."""
    program = """
import builtins, os, signal, sys
from gpis_grasp_planner.ros import node
real = builtins.__import__
def meddling(name, *rest):
    if name == "rclpy":
        builtins.__import__ = real
        os.kill(os.getpid(), int(sys.argv[1]))
    return real(name, *rest)
builtins.__import__ = meddling
sys.exit(node.main())
"""
    run = subprocess.run(
        [sys.executable, "-c", program, str(int(number))], capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    assert "Traceback" not in run.stderr


@pytest.mark.parametrize("variable", ["ROS_LOG_DIR", "ROS_HOME", "HOME"])
def test_a_folder_for_logs_that_cannot_be_made_is_no_matter(
    start_node: Start, variable: str
) -> None:
    others = dict.fromkeys({"ROS_LOG_DIR", "ROS_HOME"} - {variable}, "")
    node = start_node({}, {**others, variable: "/proc/none"})
    node.wait_ready()
    assert node.end() == 0
    assert "Traceback" not in node.text()


def test_the_worker_does_not_outlive_a_killed_node(start_node: Start) -> None:
    node = start_node()
    node.wait_ready()
    worker = node.wait_worker()
    assert node.end(signal.SIGKILL) == -signal.SIGKILL
    assert gone(worker, 90.0)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"default_n_grasps": "0"}, ["default_n_grasps", "[1, 200]"]),
        ({"default_n_grasps": "many"}, ["default_n_grasps", "'many'", "a whole number"]),
        ({"max_pose_age_s": "[1.0]"}, ["max_pose_age_s", "such as 2.0"]),
        ({"mesh_directories": "/there/is/none"}, ["/there/is/none"]),
        ({"default_time_budget_s": "100.0", "max_time_budget_s": "10.0"}, ["max_time_budget_s"]),
        ({"pose_type": "odometry"}, ["odometry", "pose_with_covariance_stamped"]),
        ({"max_pose_aeg_s": "1.0"}, ["max_pose_aeg_s", "max_pose_age_s"]),
        ({"mesh_directories": "[/there/is/none]"}, ["/there/is/none"]),
    ],
)
def test_a_bad_parameter_at_the_start_is_refused_with_the_reason(
    start_node: Start, parameters: dict[str, str], words: list[str]
) -> None:
    node = start_node(parameters)
    assert node.process.wait(timeout=90.0) == 2, node.text()
    for word in words:
        assert word in node.text()
    assert "Traceback" not in node.text()


def test_asked_for_security_it_does_not_start_unsecured(start_node: Start, tmp_path: Path) -> None:
    keystore = tmp_path / "keystore"
    (keystore / "enclaves").mkdir(parents=True)
    node = start_node(
        environment={"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_KEYSTORE": str(keystore)}
    )
    assert node.process.wait(timeout=90.0) == 2, node.text()
    assert "security" in node.text().lower()
    assert "Ready" not in node.text()


class Parameters:
    """The node's parameter services."""

    def __init__(self, client: Any, tools: Any) -> None:
        self._client, self._tools = client, tools

    def _call(self, kind: Any, name: str, request: Any) -> Any:
        """Call a service, and once more where DDS lost the first call during discovery."""
        service = self._client.node.create_client(kind, f"/grasp_planner/{name}")
        assert service.wait_for_service(timeout_sec=60.0)
        calls = [service.call_async(request)]
        deadline = time.monotonic() + 10.0
        while not calls[0].done() and time.monotonic() < deadline:
            time.sleep(0.01)
        if not calls[0].done():
            calls.append(service.call_async(request))
        self._tools.wait(lambda: any(call.done() for call in calls), name)
        self._client.in_executor(self._client.node.destroy_client, service)
        return next(call.result() for call in calls if call.done())

    def set(self, name: str, value: Any) -> Any:
        kinds = {
            int: (ParameterType.PARAMETER_INTEGER, "integer_value"),
            float: (ParameterType.PARAMETER_DOUBLE, "double_value"),
            str: (ParameterType.PARAMETER_STRING, "string_value"),
        }
        kind, field = kinds[type(value)]
        message = ParameterMessage(name=name, value=ParameterValue(type=kind, **{field: value}))
        request = SetParameters.Request(parameters=[message])
        return self._call(SetParameters, "set_parameters", request).results[0]

    def get(self, name: str) -> ParameterValue:
        request = GetParameters.Request(names=[name])
        return self._call(GetParameters, "get_parameters", request).values[0]

    def describe(self, names: list[str]) -> list[Any]:
        request = DescribeParameters.Request(names=names)
        return list(self._call(DescribeParameters, "describe_parameters", request).descriptors)


def test_parameters_and_diagnostics_of_a_running_node(
    start_node: Start, client: Any, tools: Any
) -> None:
    node = start_node({"diagnostics_period_s": "0.2"})
    node.wait_ready()
    parameters = Parameters(client, tools)

    infos = parameter_infos()
    for descriptor, info in zip(parameters.describe(list(infos)), infos.values(), strict=True):
        assert descriptor.description == info.description

    for name, bad, words in (
        ("max_pose_age_s", -1.0, ["max_pose_age_s", "-1"]),
        ("max_pose_age_s", 3, ["DOUBLE"]),
        ("default_planner", "magic", ["magic", "hpp"]),
        ("max_time_budget_s", 1.0, ["default_time_budget_s", "max_time_budget_s"]),
        ("pose_type", "pose_with_covariance_stamped", ["read-only"]),
    ):
        before = parameters.get(name)
        result = parameters.set(name, bad)
        assert not result.successful, name
        for word in words:
            assert word in result.reason
        assert parameters.get(name) == before

    assert parameters.set("max_time_budget_s", 15.0).successful
    refused = client.plan("mug", time_budget=16.0)
    assert refused.code == ErrorCode.TIME_BUDGET_OUT_OF_RANGE
    assert "[0.1, 15] s" in refused.message

    received: list[DiagnosticArray] = []
    client.node.create_subscription(DiagnosticArray, "/diagnostics", received.append, 10)
    worker = node.wait_worker()
    tools.wait(lambda: bool(received), "/diagnostics")
    values = {pair.key: pair.value for pair in received[-1].status[0].values}
    assert values["planning process"] == str(worker)
    assert values["last answer"] == "TIME_BUDGET_OUT_OF_RANGE"

    # A worker that is lost while idle comes back by itself.
    os.kill(worker, signal.SIGKILL)
    assert node.wait_worker(other_than=worker) != worker
    assert node.end() == 0


def test_estimates_with_covariance_by_parameter(
    start_node: Start, client: Any, tools: Any, parts: Path
) -> None:
    node = start_node(
        {
            "mesh_directories": f"[{parts}]",
            "pose_type": "pose_with_covariance_stamped",
            "planning_grace_s": "60.0",
        }
    )
    node.wait_ready()
    publisher = client.node.create_publisher(PoseWithCovarianceStamped, "object_pose", 1)
    tools.wait(lambda: publisher.get_subscription_count() > 0, "the node")

    def answer_at(age_s: float) -> Any:
        estimate = tools.stamped(client, age_s, frame="camera", xyz=(0.0, 0.0, 1.0))
        covariance = PoseWithCovariance(pose=estimate.pose)
        publisher.publish(PoseWithCovarianceStamped(header=estimate.header, pose=covariance))
        return client.plan("sphere", object_pose=PoseStamped(), time_budget=6.0)

    tools.wait(lambda: answer_at(60.0).code == ErrorCode.STALE_POSE, "the stale estimate")
    here = client.plan("sphere", time_budget=6.0)
    tools.wait(lambda: answer_at(0.0).success, "the new estimate")
    there = answer_at(0.0)
    assert there.from_cache
    for a, b in zip(here.grasps, there.grasps, strict=True):
        assert b.palm_pose.header.frame_id == "camera"
        T_object_palm = np.linalg.inv(tools.matrix(tools.pose().pose)) @ tools.matrix(
            a.palm_pose.pose
        )
        T_camera_object = tools.matrix(tools.pose(xyz=(0.0, 0.0, 1.0)).pose)
        T_camera_palm = tools.matrix(b.palm_pose.pose)
        np.testing.assert_allclose(T_camera_palm, T_camera_object @ T_object_palm, atol=1e-9)
    client.in_executor(client.node.destroy_publisher, publisher)
    assert node.end() == 0


def test_help_is_printed_and_nothing_is_started() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "gpis_grasp_planner.ros.node", "--help"],
        capture_output=True,
        text=True,
        timeout=60.0,
        check=True,
    )
    assert "mesh_directories:=['/home/me/parts']" in done.stdout
    assert "Ready" not in done.stdout + done.stderr
