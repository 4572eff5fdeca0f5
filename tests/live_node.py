"""The node as a process, and a client of everything it offers; for programs that test it."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from typing import Any, Self

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import QoSProfile
from spinning_executor import SpinningExecutor

from gpis_grasp_msgs.action import PlanGrasp as PlanGraspAction
from gpis_grasp_msgs.msg import PartPoses
from gpis_grasp_msgs.srv import PlanGrasp

READY_S, ANSWER_S = 180.0, 60.0
MANY = QoSProfile(depth=2000)


class LiveNode:
    """A node process with a log file; a context manager that ends it.

    Parameters
    ----------
    log : Path
    parameters : dict
        By name, as one writes them on the command line.
    namespace : str
    environment : dict, optional
        Of the process; None inherits.
    before : list of str
        Words in front of the command, such as ``["unshare", "-m"]``.
    """

    def __init__(
        self,
        log: Path,
        parameters: dict[str, str],
        namespace: str = "/",
        environment: dict[str, str] | None = None,
        before: list[str] | None = None,
    ) -> None:
        words = ["--ros-args", "-r", f"__ns:={namespace}"]
        for name, value in parameters.items():
            words += ["-p", f"{name}:={value}"]
        command = [sys.executable, "-m", "gpis_grasp_planner.ros.node", *words]
        self.log = log
        with log.open("wb") as output:
            self.process = subprocess.Popen(
                [*(before or []), *command], stdout=output, stderr=output, env=environment
            )

    def __enter__(self) -> Self:
        deadline = time.monotonic() + READY_S
        while "Ready: service" not in self.text():
            if self.process.poll() is not None or time.monotonic() > deadline:
                self.end()
                raise RuntimeError(f"The node is not ready:\n{self.text()}")
            time.sleep(0.05)
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    @property
    def pid(self) -> int:
        """Process ID of the node."""
        return self.process.pid

    def text(self) -> str:
        """What it has printed so far."""
        return self.log.read_text(errors="replace")

    def worker(self) -> int:
        """Process ID of the planning process; waits until there is one."""
        deadline = time.monotonic() + READY_S
        while time.monotonic() < deadline:
            if found := children(self.pid):
                return found[0]
            time.sleep(0.01)
        raise RuntimeError("there is no planning process")

    def end(self) -> int:
        """End it with SIGTERM, or SIGKILL where it does not go; its exit code."""
        self.process.terminate()
        try:
            return self.process.wait(timeout=30.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()


class NodeClient:
    """Service, action and estimates of a node, from any thread; a context manager."""

    def __init__(self, name: str, namespace: str = "/") -> None:
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self.node = Node(name, context=self._context, namespace=namespace)
        self._service = self.node.create_client(PlanGrasp, "plan_grasp", qos_profile=MANY)
        self._known = self.node.create_client(PlanGrasp, "get_grasps", qos_profile=MANY)
        self._action = ActionClient(self.node, PlanGraspAction, "plan_grasp")
        self.parts = self.node.create_publisher(PartPoses, "part_poses", 10)
        self._executor = SpinningExecutor(self.node, context=self._context)

    def __enter__(self) -> Self:
        there = self._service.wait_for_service(READY_S) and self._action.wait_for_server(READY_S)
        if not there:
            self.__exit__()
            raise RuntimeError("the node's service or action is not there")
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.end()
        self._action.destroy()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def begin(self, request: Any, *, only_known: bool = False) -> Any:
        """Send a request of plan_grasp, or get_grasps; a future of its answer."""
        return (self._known if only_known else self._service).call_async(request)

    def call(self, request: Any) -> Any:
        """The answer to a request, None where none came in a minute."""
        return waited(self.begin(request))

    def send_goal(self, request: Any) -> Goal:
        """Send the same as a goal; returns once it is accepted."""
        goal = Goal()
        fields = PlanGraspAction.Goal.get_fields_and_field_types()
        message = PlanGraspAction.Goal(**{name: getattr(request, name) for name in fields})
        run = self._executor.run
        goal.handle = waited(run(self._action.send_goal_async, message, goal.take_feedback))
        goal.result = run(goal.handle.get_result_async)
        goal.cancel = partial(run, goal.handle.cancel_goal_async)
        return goal


class Goal:
    """A goal on its way: its feedback so far, and a future of its result."""

    def __init__(self) -> None:
        self.handle: Any = None
        self.result: Any = None
        self.cancel: Callable[[], Any]
        self.phase = ""

    def take_feedback(self, message: Any) -> None:
        self.phase = message.feedback.phase

    def wait_phase(self, phase: str) -> bool:
        """Wait until a phase is told; False where the result comes first."""
        while not self.result.done():
            if self.phase == phase:
                return True
            time.sleep(0.005)
        return False

    def answer(self) -> Any:
        """The result, None where none came in a minute."""
        wrapped = waited(self.result)
        return None if wrapped is None else wrapped.result


def waited(future: Any, limit_s: float = ANSWER_S) -> Any:
    """What a ROS future holds once it is done, None where that takes longer."""
    done: Future[None] = Future()
    future.add_done_callback(lambda _: done.done() or done.set_result(None))
    try:
        done.result(limit_s)
    except TimeoutError:
        return None
    return future.result()


def plan_request(mesh_id: str, **fields: Any) -> Any:
    """A short request without trials, with a pose in the frame "world"."""
    pose = PoseStamped()
    pose.header.frame_id = "world"
    pose.pose.position.x = 0.5
    values = {"time_budget": 0.5, "verification": "none", "object_pose": pose, **fields}
    return PlanGrasp.Request(mesh_id=mesh_id, **values)


def children(pid: int) -> list[int]:
    """Process IDs of the children of a process, oldest first; [] where it is gone."""
    found: list[int] = []
    try:
        for task in Path(f"/proc/{pid}/task").iterdir():
            found += map(int, (task / "children").read_text().split())
    except (FileNotFoundError, ProcessLookupError):
        return []
    return sorted(found)
