"""A real node process, and a client that talks to it over real DDS."""

from __future__ import annotations

import gc
import math
import os
import shutil
import signal
import struct
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
import rclpy.time
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import QoSProfile
from spinning_executor import SpinningExecutor
from std_msgs.msg import Header

from gpis_grasp_msgs.action import PlanGrasp as PlanGraspAction
from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.geometry.catalogue import default_catalogue_directory

with warnings.catch_warnings():
    # The generator's parser, which rclpy loads with the first message type, uses sre_parse.
    warnings.simplefilter("ignore", DeprecationWarning)
    import rosidl_generator_py  # noqa: F401

READY_S = 90.0  # a bound on a hang, not a measurement: machines that run tests may be busy
ANSWER_S = 120.0
LEAVE_S = 10.0
MAX_POSE_AGE_S = 3.0


class NodeProcess:
    """The node as users start it: a plain process."""

    def __init__(
        self,
        log: Path,
        parameters: dict[str, str],
        environment: dict[str, str] | None = None,
        main: str = "main",
        before: str = "",
    ) -> None:
        arguments = [f"{name}:={value}" for name, value in parameters.items()]
        self.log = log
        with log.open("wb") as output:
            self.process = subprocess.Popen(
                [
                    sys.executable,
                    *(
                        ("-m", "gpis_grasp_planner.ros.node")
                        if main == "main"
                        else ("-c", f"{before}import gpis_grasp_planner.ros.node as n; n.{main}()")
                    ),
                    *(["--ros-args"] if arguments else []),
                    *(word for argument in arguments for word in ("-p", argument)),
                ],
                stdout=output,
                stderr=subprocess.STDOUT,
                cwd=log.parent,
                env={**os.environ, **(environment or {})},
            )

    def text(self) -> str:
        """What the node has printed so far."""
        return self.log.read_text(errors="replace")

    def wait_ready(self) -> None:
        deadline = time.monotonic() + READY_S
        while "Ready: service" not in self.text():
            assert self.process.poll() is None, self.text()
            assert time.monotonic() < deadline, self.text()
            time.sleep(0.05)

    def workers(self) -> list[int]:
        """Process IDs of the children, whichever thread has started them."""
        tasks = Path(f"/proc/{self.process.pid}/task")
        return [int(pid) for t in tasks.iterdir() for pid in (t / "children").read_text().split()]

    def wait_worker(self, other_than: int = -1) -> int:
        """Process ID of the planning process, once there is one other than the given."""
        deadline = time.monotonic() + READY_S
        while time.monotonic() < deadline:
            found = [pid for pid in self.workers() if pid != other_than]
            if found:
                return found[0]
            time.sleep(0.02)
        raise AssertionError(f"no planning process appeared:\n{self.text()}")

    def end(self, number: int = signal.SIGTERM) -> int:
        """Send a signal and return the exit code."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.process.wait(timeout=30.0)


class Client:
    """A ROS node of the test's own, spinning in a thread."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = Node("grasp_client", context=self.context)
        # All answers of the node pass through every client's reader.
        many = QoSProfile(depth=1000)
        self._service = self.node.create_client(PlanGrasp, "plan_grasp", qos_profile=many)
        self._executor = SpinningExecutor(self.node, context=self.context)
        self.in_executor = self._executor.run

    def call(self, request: PlanGrasp.Request) -> PlanGrasp.Response:
        """Call plan_grasp where one node alone offers it: with two, either could answer."""
        assert self._service.wait_for_service(timeout_sec=READY_S)
        wait_for(
            lambda: self.node.count_services("plan_grasp") == 1, "one node alone", seconds=READY_S
        )
        future = self.call_async(request)
        done = threading.Event()
        future.add_done_callback(lambda _future: done.set())
        assert done.wait(ANSWER_S), "plan_grasp did not answer"
        return future.result()

    def call_async(self, request: PlanGrasp.Request) -> Any:
        assert self._service.wait_for_service(timeout_sec=READY_S)
        return self._service.call_async(request)

    def plan(self, mesh_id: str = "mug", **fields: Any) -> PlanGrasp.Response:
        """Call with the object at a fixed pose in the frame "world", unless told otherwise."""
        return self.call(plan_request(mesh_id, **fields))

    def prepare(self, mesh_id: str) -> None:
        """Have the planning process read and prepare a mesh, however long that takes.

        The time budget counts the preparation, so that a first request with a second may end
        before its search has begun. A goal with time enough is cancelled as soon as it searches; it
        leaves the mesh prepared and no plan.
        """
        action = self.in_executor(ActionClient, self.node, PlanGraspAction, "plan_grasp")
        assert action.wait_for_server(READY_S)
        phases: list[str] = []
        request = plan_request(mesh_id, time_budget=60.0)
        fields = {name: getattr(request, name) for name in request.get_fields_and_field_types()}
        sent = self.in_executor(
            action.send_goal_async,
            PlanGraspAction.Goal(**fields),
            lambda message: phases.append(message.feedback.phase),
        )
        wait_for(sent.done, "the goal's acceptance", seconds=READY_S)
        result = self.in_executor(sent.result().get_result_async)
        wait_for(lambda: "searching" in phases or result.done(), "a search", seconds=ANSWER_S)
        assert not result.done(), result.result().result.message
        self.in_executor(sent.result().cancel_goal_async)
        wait_for(result.done, "the end of the goal", seconds=ANSWER_S)
        self.in_executor(action.destroy)

    def close(self) -> None:
        self._executor.end()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


def plan_request(mesh_id: str = "mug", **fields: Any) -> PlanGrasp.Request:
    """A short request with a pose, unless `object_pose` or `time_budget` are given."""
    pose = PoseStamped()
    pose.header.frame_id = "world"
    pose.pose.position.x = 0.5
    values = {"time_budget": 1.0, "object_pose": pose, **fields}
    return PlanGrasp.Request(mesh_id=mesh_id, **values)


def wait_for(condition: Callable[[], bool], what: str, seconds: float = 30.0) -> None:
    """Wait until a condition holds."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, f"timed out waiting for: {what}"
        time.sleep(0.02)


def stl(triangles: np.ndarray, count: int | None = None) -> bytes:
    """Binary STL of triangles (n, 3, 3)."""
    data = bytes(80) + struct.pack("<I", len(triangles) if count is None else count)
    for corners in triangles:
        data += struct.pack("<12fH", 0, 0, 0, *corners.ravel(), 0)
    return data


def box(side_m: float) -> np.ndarray:
    """Triangles (12, 3, 3) of a cube, seen counter-clockwise from outside."""
    x = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)]) * side_m
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return np.array([[x[a], x[b], x[c]] for q in quads for a, b, c in (q[:3], (q[0], *q[2:]))])


def pose(frame: str = "world", xyz: Any = (0.5, 0.0, 0.0), xyzw: Any = (0, 0, 0, 1)) -> PoseStamped:
    p, q = ([float(v) for v in values] for values in (xyz, xyzw))
    return PoseStamped(
        header=Header(frame_id=frame),
        pose=Pose(
            position=Point(x=p[0], y=p[1], z=p[2]),
            orientation=Quaternion(x=q[0], y=q[1], z=q[2], w=q[3]),
        ),
    )


def stamped(client: Any, age_s: float, **fields: Any) -> PoseStamped:
    message = pose(**fields)
    now = client.node.get_clock().now()
    message.header.stamp = (now - rclpy.time.Duration(seconds=age_s)).to_msg()
    return message


def matrix(message: Pose) -> np.ndarray:
    """Homogeneous matrix of a pose, by the textbook formula."""
    q, p = message.orientation, message.position
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), p.x],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), p.y],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), p.z],
            [0, 0, 0, 1],
        ]
    )


@pytest.fixture(scope="session")
def tools() -> Any:
    """The helpers of this file, for test modules (they cannot import a conftest)."""

    class Tools:
        node_process = NodeProcess
        request = staticmethod(plan_request)
        wait = staticmethod(wait_for)
        stl = staticmethod(stl)
        box = staticmethod(box)
        pose = staticmethod(pose)
        stamped = staticmethod(stamped)
        matrix = staticmethod(matrix)
        max_pose_age_s = MAX_POSE_AGE_S

    return Tools


@pytest.fixture(scope="module", autouse=True)
def _nodes_of_other_files_are_gone() -> None:
    """A node of this process stays in the graph until the collector has all that refers to it."""
    gc.collect()


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    made = Client()
    yield made
    made.close()


@pytest.fixture(scope="module")
def start_node(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., NodeProcess]]:
    """Starts nodes and ends those that a test leaves running."""
    started: list[NodeProcess] = []

    def start(
        parameters: dict[str, str] | None = None,
        environment: dict[str, str] | None = None,
        main: str = "main",
        before: str = "",
    ) -> NodeProcess:
        log = tmp_path_factory.mktemp("node") / "node.log"
        # Trials in physics take time; who wants them says so.
        quick = {"default_verification": "none", **(parameters or {})}
        started.append(NodeProcess(log, quick, environment, main, before))
        return started[-1]

    yield start
    for node in started:
        if node.process.poll() is None:
            node.process.terminate()  # the others hear that it leaves
            with suppress(subprocess.TimeoutExpired):
                node.process.wait(LEAVE_S)
            node.process.kill()
            node.process.wait()


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A catalogue with one good part and every kind of bad one."""
    folder = tmp_path_factory.mktemp("parts")
    for name in ("mug.stl", "mug.yaml", "sphere.stl", "sphere.yaml"):
        shutil.copy(default_catalogue_directory() / name, folder)
    cube = stl(box(0.05))
    (folder / "empty.stl").write_bytes(b"")
    (folder / "truncated.stl").write_bytes(cube[: len(cube) // 2])
    broken = box(0.05)
    broken[3, 1, 2] = math.nan
    (folder / "nan.stl").write_bytes(stl(broken))
    (folder / "millimetres.stl").write_bytes(stl(box(50.0)))
    (folder / "crate.stl").write_bytes(stl(box(0.9)))
    outside = tmp_path_factory.mktemp("outside") / "secret.stl"
    outside.write_bytes(cube)
    (folder / "link.stl").symlink_to(outside)
    os.mkfifo(folder / "pipe.stl")
    return folder


@pytest.fixture(scope="module")
def node(start_node: Callable[..., Any], parts: Path) -> Iterator[Any]:
    started = start_node(
        {
            "mesh_directories": f"[{parts}]",
            "max_pose_age_s": str(MAX_POSE_AGE_S),
            "planning_grace_s": "60.0",
            "default_planner": "hpp",
            "queue_size": "1",
            "diagnostics_period_s": "0.2",
            "uncertainty.samples": "16",
        }
    )
    started.wait_ready()
    yield started
    assert started.end() == 0, started.text()


@pytest.fixture(scope="module")
def planned(node: Any, client: Any) -> PlanGrasp.Response:
    """A first good answer, which the later ones with the same request come from."""
    for mesh_id in ("sphere", "mug"):
        client.prepare(mesh_id)
        response = client.plan(mesh_id)
    assert response.success, response.message
    assert not response.from_cache
    return response
