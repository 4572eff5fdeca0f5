"""Figures of the node: start to ready, memory with a plan in it, latency of the service."""

from __future__ import annotations

import argparse
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 101))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("GPIS_GRASP_STORE", "off")

import rclpy
from rclpy.node import Node

from gpis_grasp_msgs.srv import PlanGrasp

LIMIT_S = 300.0
TABLE_M = -0.037  # under the shipped mug


def start_node(log: Path) -> tuple[Any, float]:
    """Start the node; return it and the time from its start to its ready line [s]."""
    start = time.monotonic()
    with log.open("wb") as output:
        command = [sys.executable, "-m", "gpis_grasp_planner.ros.node"]
        child = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)
    while "Ready: service" not in log.read_text(errors="replace"):
        if child.poll() is not None or time.monotonic() - start > LIMIT_S:
            raise RuntimeError(log.read_text(errors="replace"))
        time.sleep(0.01)
    return child, time.monotonic() - start


def end_node(child: Any) -> None:
    """End the node with SIGTERM; kill it if it does not go."""
    child.send_signal(signal.SIGTERM)
    try:
        child.wait(timeout=15.0)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


def memory_mb(pid: int) -> tuple[float, float]:
    """Resident and proportional (shared pages divided among their users) memory [MB]."""
    values = {}
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:]:
        name, number, *_ = line.split()
        values[name] = float(number) / 1024.0
    return values["Rss:"], values["Pss:"]


def children(pid: int) -> list[int]:
    """Process IDs of the children of a process."""
    tasks = Path(f"/proc/{pid}/task").iterdir()
    return [int(child) for task in tasks for child in (task / "children").read_text().split()]


def memory_rows(node: int, when: str) -> list[str]:
    """Lines of the table: memory of the node, of its planning process, and of both."""
    [worker] = children(node)
    values = {"the node": memory_mb(node), "its planning process": memory_mb(worker)}
    values["together"] = tuple(map(sum, zip(*values.values(), strict=True)))
    return [
        f"| resident memory with {when}, {name} | {rss:.0f} MB (proportional {pss:.0f}) |"
        for name, (rss, pss) in values.items()
    ]


class Caller(Node):
    """A client of plan_grasp."""

    def __init__(self) -> None:
        super().__init__("benchmark")
        self._service = self.create_client(PlanGrasp, "plan_grasp")

    def send(
        self, mesh_id: str, budget_s: float, seed: int = 0, table_m: float | None = None
    ) -> Any:
        """Send a request, with a table at a height below the part's origin; return its future."""
        request = PlanGrasp.Request(mesh_id=mesh_id, time_budget=budget_s, seed=seed)
        request.object_pose.header.frame_id = "world"
        if table_m is not None:
            request.support_plane.header.frame_id = "world"
            request.support_plane.pose.position.z = table_m
        self._service.wait_for_service(timeout_sec=LIMIT_S)
        return self._service.call_async(request)

    def call(
        self, mesh_id: str, budget_s: float, seed: int = 0, table_m: float | None = None
    ) -> tuple[Any, float]:
        """Call; return the answer and its time [s]."""
        start = time.monotonic()
        future = self.send(mesh_id, budget_s, seed, table_m)
        rclpy.spin_until_future_complete(self, future, timeout_sec=LIMIT_S)
        return future.result(), time.monotonic() - start


def latency_row(name: str, times_s: list[float]) -> str:
    """One line of the table: median and largest of some times."""
    ordered = sorted(times_s)
    return (
        f"| {name} | {1e3 * statistics.median(ordered):.1f} ms, at most {1e3 * ordered[-1]:.1f} |"
    )


def measure(n_starts: int, n_calls: int, budget_s: float) -> list[str]:
    """Lines of a Markdown table."""
    starts = []
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "node.log"
        for _ in range(n_starts - 1):
            child, seconds = start_node(log)
            starts.append(seconds)
            end_node(child)
        child, seconds = start_node(log)
        starts.append(seconds)
        rclpy.init()
        try:
            caller = Caller()
            first, first_s = caller.call("mug", budget_s)
            memory = memory_rows(child.pid, "one plan")
            second, second_s = caller.call("flask", budget_s)
            memory += memory_rows(child.pid, "two plans")
            if not (first.success and second.success):
                raise RuntimeError(f"{first.message} {second.message}")
            cached = [caller.call("mug", budget_s)[1] for _ in range(n_calls)]
            on_table = [caller.call("mug", budget_s, table_m=TABLE_M)[1] for _ in range(n_calls)]
            running = caller.send("mug", 3.0 * budget_s, seed=1)
            time.sleep(0.5)
            during = [caller.call("mug", budget_s)[1] for _ in range(n_calls)]
            placed = [
                caller.call("mug", budget_s, table_m=TABLE_M)[1]
                for _ in range(max(1, n_calls // 5))
            ]
            refused = [caller.call("no-such-part", budget_s)[1] for _ in range(n_calls)]
            ran_throughout = not running.done()
            rclpy.spin_until_future_complete(caller, running, timeout_sec=LIMIT_S)
        finally:
            rclpy.try_shutdown()
            end_node(child)
    if not ran_throughout:
        raise RuntimeError("The plan ended before the calls beside it; give a larger --budget.")
    return [
        "| figure | value |",
        "|---|---|",
        f"| start to ready, median of {n_starts} | {statistics.median(starts):.2f} s, "
        f"at most {max(starts):.2f} |",
        *memory,
        f"| first plan right after the start, budget {budget_s:g} s | {first_s:.1f} s |",
        f"| first plan of another part | {second_s:.1f} s |",
        latency_row(f"call answered from memory, {n_calls} calls", cached),
        latency_row("the same while another plan runs", during),
        latency_row(f"kept plan answered for a mug on a table, {n_calls} calls", on_table),
        latency_row("the same while another plan runs", placed),
        latency_row("unknown mesh refused while another plan runs", refused),
    ]


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=3)
    parser.add_argument("--calls", type=int, default=50)
    parser.add_argument("--budget", type=float, default=5.0, help="time budget of the plans [s]")
    options = parser.parse_args()
    print("\n".join(measure(options.starts, options.calls, options.budget)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
