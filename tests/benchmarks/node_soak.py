"""Many clients at once: lost answers, BUSY, cached answers beside covariances, cancels, memory."""

from __future__ import annotations

import argparse
import multiprocessing
import os
import random
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Self

os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 101))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("GPIS_GRASP_STORE", "off")

import numpy as np
import rclpy
from geometry_msgs.msg import PoseWithCovariance
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile

from gpis_grasp_msgs.action import PlanGrasp as PlanGraspAction
from gpis_grasp_msgs.msg import PartPose, PartPoses
from gpis_grasp_msgs.srv import PlanGrasp

MANY = QoSProfile(depth=2000)
LIMIT_S = 120.0
MESHES = ("mug", "sphere", "flask", "phone")


class Clients:
    """Some clients of plan_grasp in one process, each a node of its own."""

    def __init__(self, name: str, number: int) -> None:
        rclpy.init()
        self._executor = SingleThreadedExecutor()
        self.nodes = [Node(f"{name}_{k}") for k in range(number)]
        self.services = [
            node.create_client(PlanGrasp, "plan_grasp", qos_profile=MANY) for node in self.nodes
        ]
        for node, service in zip(self.nodes, self.services, strict=True):
            self._executor.add_node(node)
            if not service.wait_for_service(LIMIT_S):
                raise RuntimeError("the node is not there")
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def _spin(self) -> None:
        while not self._ended.is_set():
            self._executor.spin_once(timeout_sec=0.2)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
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


def burst(arguments: tuple[int, int, int, float]) -> list[tuple[int, float, bool]]:
    """One process: all its clients call at the same moments; code (-1 lost), time, crossed."""
    number, clients, rounds, begin = arguments
    group = Clients(f"burst_{number}", clients)
    rows: list[tuple[int, float, bool]] = []
    with group, ThreadPoolExecutor(clients) as threads:
        for k in range(rounds):
            time.sleep(max(begin + 12.0 * k - time.time(), 0.0))
            requests = [
                request_for("sphere", seed=number * 10**6 + k * 10**3 + c) for c in range(clients)
            ]
            for answer, seconds in threads.map(group.call, range(clients), requests):
                rows.append((-1 if answer is None else answer.code, seconds, False))
    return rows


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
        return [row for rows in pool.map(task, arguments) for row in rows]


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


def line(name: str, times: list[float]) -> str:
    """Median, 99th percentile and largest of times, in milliseconds."""
    if not times:
        return f"| {name} | none |"
    p50, p99 = np.percentile(1e3 * np.array(times), [50, 99])
    return f"| {name} | {len(times)}: {p50:.1f}, {p99:.1f}, {1e3 * max(times):.1f} ms |"


def memory_mb(pid: int) -> float:
    """Proportional memory of a process and its children [MB]."""
    pids = [pid]
    for task in Path(f"/proc/{pid}/task").iterdir():
        pids += map(int, (task / "children").read_text().split())
    total = 0.0
    for each in pids:
        for row in Path(f"/proc/{each}/smaps_rollup").read_text().splitlines():
            if row.startswith("Pss:"):
                total += float(row.split()[1]) / 1024.0
    return total


def main() -> None:
    """Start a node and put it under load."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clients", type=int, default=100, help="calling at once (100)")
    parser.add_argument("--rounds", type=int, default=10, help="of calls at once (10)")
    parser.add_argument("--calls", type=int, default=200, help="mixed, of each of 50 clients (200)")
    parser.add_argument("--cancels", type=int, default=200, help="goals to cancel (200)")
    parser.add_argument("--processes", type=int, default=4, help="that the clients are in (4)")
    options = parser.parse_args()
    log = Path(tempfile.mkdtemp(prefix="gpis_soak_")) / "node.log"
    with log.open("wb") as output:
        node = subprocess.Popen(
            [sys.executable, "-m", "gpis_grasp_planner.ros.node"], stdout=output, stderr=output
        )
    try:
        report(options, node.pid)
    finally:
        node.terminate()
        code = node.wait(timeout=30.0)
    text = log.read_text(errors="replace")
    print(f"| exit code; tracebacks in the log | {code}; {text.count('Traceback')} |")


def report(options: Any, pid: int) -> None:
    """Print the table."""
    with Clients("soak", 1) as main_client:
        report_with(main_client, options, pid)


def report_with(main_client: Clients, options: Any, pid: int) -> None:
    """Print the rows of the table, with a client of this process."""
    processes = options.processes
    for mesh_id in MESHES:
        answer = None
        while answer is None or answer.code not in (0, 400):
            answer, _ = main_client.call(0, request_for(mesh_id))
    print("| measure | number: median, 99th percentile, largest |\n|---|---|")
    before = memory_mb(pid)
    quiet = [main_client.call(0, request_for("mug"))[1] for _ in range(500)]
    print(line("cached answer, nothing else", quiet), flush=True)

    end = time.time() + 30.0
    context = multiprocessing.get_context("spawn")
    with context.Pool(2) as pool:
        asked = pool.map_async(covariances, [(k, 6, end) for k in range(2)])
        time.sleep(8.0)
        beside = []
        while time.time() < end - 2.0:
            beside.append(main_client.call(0, request_for("mug"))[1])
            time.sleep(0.01)
        codes = sum(asked.get(LIMIT_S), Counter())
    print(line("cached answer beside 12 clients with covariances", beside))
    print(f"| their answers by code | {dict(codes)} |", flush=True)

    share = options.clients // processes
    begin = time.time() + 10.0 + 0.2 * share
    rows = in_processes(burst, [(k, share, options.rounds, begin) for k in range(processes)])
    lost = sum(code == -1 for code, _, _ in rows)
    print(f"| {share * processes} at once, {options.rounds} rounds: answers | {len(rows)} |")
    print(f"| of them lost; by code | {lost}; {dict(Counter(code for code, _, _ in rows))} |")
    print(line("BUSY", [seconds for code, seconds, _ in rows if code == 500]), flush=True)

    share = 50 // processes
    begin = time.time() + 10.0 + 0.2 * share
    rows = in_processes(mix, [(k, share, options.calls, begin) for k in range(processes)])
    lost = sum(code == -1 for code, _, _ in rows)
    wrong = sum(bad for _, _, bad in rows)
    print(f"| mixed calls of {share * processes} clients: answers | {len(rows)} |")
    print(f"| lost; crossed | {lost}; {wrong} |")
    print(f"| by code | {dict(Counter(code for code, _, _ in rows))} |")
    print(line("refusals", [s for code, s, _ in rows if code in (101, 102)]), flush=True)

    print(line("cancel", cancels(options.cancels)))
    print(f"| memory before and after | {before:.0f}, {memory_mb(pid):.0f} MB |", flush=True)
    status = Path(f"/proc/{pid}/status").read_text()
    threads = next(row.split()[1] for row in status.splitlines() if row.startswith("Threads"))
    files = len(list(Path(f"/proc/{pid}/fd").iterdir()))
    print(f"| threads, descriptors of the node | {threads}, {files} |")


if __name__ == "__main__":
    main()
