"""A Dask scheduler and workers as processes of their own, for the tests."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

from terminal_sessions import PROGRAM, environment

# A worker of another version of the planner.
OTHER_VERSION = """
import sys
from gpis_grasp_planner.batch import cluster
cluster.planner_version = lambda: "9.9+other"
cluster.serve_worker(sys.argv[1], 1, print)
"""


class Cluster:
    """A scheduler, and what is started for it; a context manager that ends all of them.

    Parameters
    ----------
    log : Path
        What all of them write.
    **changes : str
        Of the scheduler's environment.
    """

    def __init__(self, log: Path, **changes: str):
        self._log = log.open("a")
        self._running: list[subprocess.Popen[str]] = []
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{port}"
        where = ("--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
        program = "from distributed.cli.dask_scheduler import main; main()"
        self.scheduler = self.start([sys.executable, "-c", program, *where], **changes)

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._running[::-1]:
            process.kill()
            process.wait()
        self._log.close()

    def start(self, command: list[str], **changes: str) -> subprocess.Popen[str]:
        """Start a process that ends with the test."""
        process = subprocess.Popen(
            command,
            env=environment(**changes),
            stdout=self._log,
            stderr=self._log,
            text=True,
        )
        self._running.append(process)
        return process

    def worker(self) -> subprocess.Popen[str]:
        """Start a worker that plans one part at a time."""
        return self.start([*PROGRAM, "worker", self.address, "--jobs", "1"])

    def plan_all(self, tree: Path, store: Path, *words: str) -> subprocess.Popen[str]:
        """Start 'plan-all' on this cluster; the summary as JSON comes on its stdout."""
        there = ("--scheduler", self.address, "--set", f"store.path={store}", "--json", "-")
        process = subprocess.Popen(
            [*PROGRAM, "plan-all", str(tree), *words, *there],
            env=environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._running.append(process)
        return process


def _forked_children(worker: subprocess.Popen[str]) -> set[int]:
    """Process IDs of the forked children of a worker, each of which plans a part."""
    tasks = Path(f"/proc/{worker.pid}/task").iterdir()
    children = {int(pid) for task in tasks for pid in (task / "children").read_text().split()}
    # Programs that libraries start when they are imported have a command line of their own.
    program = _command_line(worker.pid)
    return {pid for pid in children if _command_line(pid) == program}


def part_under_way(worker: subprocess.Popen[str], limit_s: float = 120.0) -> int:
    """Wait until a worker plans a part; the process ID of its child."""
    deadline = time.monotonic() + limit_s
    before: set[int] = set()
    # Twice: a program that is started looks like its parent for a moment.
    while not (still := before & (now := _forked_children(worker))):
        assert worker.poll() is None
        assert time.monotonic() < deadline
        before = now
        time.sleep(0.1)
    return still.pop()


def kill_in_the_middle(worker: subprocess.Popen[str]) -> int:
    """Kill a worker (SIGKILL) while a part is planned; the process ID of the part's child."""
    child = part_under_way(worker)
    os.kill(worker.pid, signal.SIGKILL)
    worker.wait()
    return child


def _command_line(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:  # it has ended
        return b""
