"""The plain node and what spins it: errors in callbacks cost nobody else, an end is in order."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from real_node import plain_node

from gpis_grasp_msgs.srv import ListMeshes, PlanGrasp
from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.ros.planner_node import NODE_NAME, GraspPlannerNode, spin

LIMIT_S = 60.0


class Running:
    """A node of this process that a thread spins."""

    def __init__(self) -> None:
        self.node, self.stop = GraspPlannerNode(), threading.Event()
        self.pid = self.node._planning.supervisor.pid
        self.thread = threading.Thread(target=spin, args=(self.node, self.stop))
        self.thread.start()

    def end(self) -> None:
        self.stop.set()
        self.thread.join(LIMIT_S)
        assert not self.thread.is_alive()


@pytest.fixture
def running() -> Iterator[Running]:
    rclpy.init(args=["--ros-args", "-p", "default_verification:=none"])
    made = Running()
    yield made
    made.end()
    rclpy.try_shutdown()


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def call(client: Any, kind: Any, name: str, request: Any) -> Any:
    service = client.create_client(kind, name)
    assert service.wait_for_service(LIMIT_S)
    return service.call_async(request)


def test_it_answers_until_it_is_stopped_and_takes_its_process_with_it(running: Running) -> None:
    assert running.node.get_name() == NODE_NAME
    with plain_node("asking", spins=True) as client:
        future = call(client, ListMeshes, "list_meshes", ListMeshes.Request())
        wait_for(future.done)
        assert "mug" in [mesh.mesh_id for mesh in future.result().meshes]
    assert Path(f"/proc/{running.pid}").exists()
    running.end()
    assert not Path(f"/proc/{running.pid}").exists()


def test_a_callback_that_fails_is_logged_and_the_others_go_on(
    running: Running, capfd: pytest.CaptureFixture[str]
) -> None:
    failed = threading.Event()

    def fail() -> None:
        failed.set()
        raise ZeroDivisionError("in a callback")

    timer = running.node.create_timer(0.01, fail)
    assert failed.wait(LIMIT_S)
    with plain_node("asking", spins=True) as client:
        future = call(client, ListMeshes, "list_meshes", ListMeshes.Request())
        wait_for(future.done)
    timer.cancel()
    assert running.thread.is_alive()
    logged = ""

    def told() -> bool:
        nonlocal logged
        logged += capfd.readouterr().err
        return "In the executor: ZeroDivisionError('in a callback')" in logged

    wait_for(told)


def test_who_waits_for_a_plan_at_the_end_is_answered(running: Running) -> None:
    with plain_node("asking", spins=True) as client:
        request = PlanGrasp.Request(mesh_id="mug", time_budget=60.0)
        request.object_pose.header.frame_id = "world"
        future = call(client, PlanGrasp, "plan_grasp", request)
        answering = running.node._interfaces.answering
        wait_for(lambda: answering.n_in_work == 1)
        running.end()
        wait_for(future.done)
        assert future.result().code == ErrorCode.SHUTTING_DOWN
        assert answering.n_in_work == 0
