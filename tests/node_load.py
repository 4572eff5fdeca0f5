"""Load for a node, by processes of some clients each: at once, mixed, covariances, cancels."""

from __future__ import annotations

import math
import multiprocessing
import random
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Self

import rclpy
from geometry_msgs.msg import PoseWithCovariance
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import QoSProfile
from spinning_executor import SpinningExecutor

from gpis_grasp_msgs.action import PlanGrasp as PlanGraspAction
from gpis_grasp_msgs.msg import PartPose, PartPoses
from gpis_grasp_msgs.srv import PlanGrasp

MANY = QoSProfile(depth=2000)
LIMIT_S = 120.0
# The middleware says when an answer was written: to look seldom leaves the cores to the node.
READ_PERIOD_S = 0.2
MESHES = ("mug", "sphere", "flask", "phone")


class Clients:
    """Some clients of plan_grasp in one process, each a node of its own."""

    def __init__(self, name: str, number: int) -> None:
        rclpy.init()
        self.nodes = [Node(f"{name}_{k}") for k in range(number)]
        self.services = [
            node.create_client(PlanGrasp, "plan_grasp", qos_profile=MANY) for node in self.nodes
        ]
        if not all(service.wait_for_service(LIMIT_S) for service in self.services):
            raise RuntimeError("the node is not there")
        self._executor = SpinningExecutor(*self.nodes)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.end()
        rclpy.try_shutdown()

    def call(self, k: int, request: Any) -> tuple[Any, float]:
        """The answer to a request of client k, None where none came, and its time [s]."""
        done, start = threading.Event(), time.monotonic()
        future = self.services[k].call_async(request)
        future.add_done_callback(lambda _: done.set())
        done.wait(LIMIT_S)
        return (future.result() if future.done() else None), time.monotonic() - start


def request_for(mesh_id: str, **fields: Any) -> Any:
    """A request without trials, with a pose."""
    request = PlanGrasp.Request(mesh_id=mesh_id, time_budget=1.0, verification="none", **fields)
    request.object_pose.header.frame_id = "world"
    request.object_pose.pose.orientation.w = 1.0
    return request


def mixed_request(rng: random.Random) -> tuple[Any, str]:
    """A request of the mix, and the mesh ID that its answer must speak of."""
    kind = rng.random()
    if kind < 0.6:
        mesh_id = rng.choice(MESHES)
        return request_for(mesh_id), mesh_id
    if kind < 0.8:
        mesh_id = f"unknown{rng.randrange(10**9)}"
        return request_for(mesh_id), mesh_id
    if kind < 0.9:
        mesh_id = rng.choice(MESHES)
        bad = request_for(mesh_id)
        bad.time_budget = -1.0
        return bad, ""
    mesh_id = rng.choice(MESHES)
    return request_for(mesh_id, seed=rng.randrange(10**6)), mesh_id


def crossed(answer: Any, mesh_id: str) -> bool:
    """Whether an answer is another request's."""
    if answer.grasps:
        return any(grasp.mesh_id != mesh_id for grasp in answer.grasps)
    return mesh_id.startswith("unknown") and mesh_id not in answer.message


@dataclass(frozen=True)
class Answered:
    """An answer of many at once: its code, and times from the call on [s].

    Attributes
    ----------
    code : int
        -1 where none came.
    written_s : float
        The node handed the answer to its middleware.
    arrived_s : float
        The client's middleware had it.
    """

    code: int
    written_s: float = math.inf
    arrived_s: float = math.inf


def burst(arguments: tuple[int, int, int, float]) -> list[Answered]:
    """One process: all its clients call at the same moments, and are read without an executor."""
    number, clients, rounds, begin = arguments
    rclpy.init()
    node = Node(f"burst_{number}")
    services = [
        node.create_client(PlanGrasp, "plan_grasp", qos_profile=MANY) for _ in range(clients)
    ]
    for service in services:
        service.wait_for_service(LIMIT_S)
    rows: list[Answered] = []
    for k in range(rounds):
        time.sleep(max(begin + 12.0 * k - time.time(), 0.0))
        rows += _at_once(services, number * 10**6 + k * 10**3)
    rclpy.shutdown()
    return rows


def _at_once(services: list[Any], seed: int) -> list[Answered]:
    """One request of each client; seeds from `seed` on."""
    sent: dict[int, int] = {}
    for c, service in enumerate(services):
        request = request_for("sphere", seed=seed + c)
        sent[c] = time.time_ns()
        with service.handle:
            service.handle.send_request(request)
    rows = []
    deadline = time.monotonic() + LIMIT_S / 2.0
    while sent and time.monotonic() < deadline:
        for c in list(sent):
            with services[c].handle:
                header, answer = services[c].handle.take_response(PlanGrasp.Response)
            if header is None:
                continue
            start = sent.pop(c)
            times = header.source_timestamp, header.received_timestamp
            rows.append(Answered(answer.code, *(1e-9 * (t - start) for t in times)))
        time.sleep(READ_PERIOD_S)
    return rows + [Answered(-1)] * len(sent)


def mix(arguments: tuple[int, int, int, float]) -> list[tuple[int, float, bool]]:
    """One process: its clients call one request after the other."""
    number, clients, calls, begin = arguments
    group = Clients(f"mix_{number}", clients)
    time.sleep(max(begin - time.time(), 0.0))

    def one(k: int) -> list[tuple[int, float, bool]]:
        rng = random.Random(1000 * number + k)
        rows = []
        for _ in range(calls):
            request, mesh_id = mixed_request(rng)
            answer, seconds = group.call(k, request)
            if answer is None:
                rows.append((-1, seconds, False))
            else:
                rows.append((answer.code, seconds, bool(mesh_id) and crossed(answer, mesh_id)))
        return rows

    with group, ThreadPoolExecutor(clients) as threads:
        return [row for rows in threads.map(one, range(clients)) for row in rows]


def covariances(arguments: tuple[int, int, float]) -> Counter[int]:
    """One process: its clients ask for hold probabilities until a moment."""
    number, clients, end = arguments
    group = Clients(f"covariance_{number}", clients)
    publisher = group.nodes[0].create_publisher(PartPoses, "part_poses", 10)
    codes: Counter[int] = Counter()

    def publish() -> None:
        while time.time() < end:
            pose = PoseWithCovariance()
            pose.pose.orientation.w = 1.0
            pose.covariance[0] = pose.covariance[7] = pose.covariance[14] = 1e-6
            part = PartPose(mesh_id="sphere", pose=pose)
            part.header.frame_id = "world"
            publisher.publish(PartPoses(parts=[part]))
            time.sleep(0.2)

    publishing = threading.Thread(target=publish)
    publishing.start()

    def ask(k: int) -> None:
        while time.time() < end:
            request = request_for("sphere")
            request.object_pose.header.frame_id = ""
            request.object_pose.pose.orientation.w = 0.0
            answer, _ = group.call(k, request)
            codes[-1 if answer is None else answer.code] += 1
            time.sleep(0.05)

    with group, ThreadPoolExecutor(clients) as threads:
        list(threads.map(ask, range(clients)))
        publishing.join()
    return codes


def in_processes(task: Any, arguments: list[Any]) -> list[Any]:
    """Run a task in spawned processes; all rows that they return."""
    context = multiprocessing.get_context("spawn")
    with context.Pool(len(arguments)) as pool:
        rows = [row for rows in pool.map(task, arguments) for row in rows]
        pool.close()
        pool.join()  # ended, not terminated: rclpy keeps a process from SIGTERM
    return rows


def cancels(number: int) -> list[float]:
    """Times from a cancel to the result, at random moments of goals with trials [s]."""
    node = Node("cancelling")
    client = ActionClient(node, PlanGraspAction, "plan_grasp")
    client.wait_for_server(LIMIT_S)
    rng, times = random.Random(0), []
    for k in range(number):
        request = request_for("sphere", seed=k)
        goal = PlanGraspAction.Goal(
            mesh_id="sphere",
            object_pose=request.object_pose,
            seed=k,
            time_budget=4.0,
            verification="rank",
        )
        sent = client.send_goal_async(goal)
        rclpy.spin_until_future_complete(node, sent, timeout_sec=LIMIT_S)
        result = sent.result().get_result_async()
        end = time.monotonic() + rng.uniform(0.0, 4.0)
        while time.monotonic() < end and not result.done():
            rclpy.spin_once(node, timeout_sec=0.01)
        if result.done():
            continue
        start = time.monotonic()
        sent.result().cancel_goal_async()
        rclpy.spin_until_future_complete(node, result, timeout_sec=LIMIT_S)
        times.append(time.monotonic() - start)
    client.destroy()
    node.destroy_node()
    return times
