"""Every kind of fault on a live node, some seeded times each: its answers, and the next good one.

    python tests/benchmarks/node_faults.py --times 20

Each row: the kind; answers by code; answers that were not expected or did not come; the time to the
answer of a good request that follows (a new plan, budget 1.5 s). Exit code 1 where anything was
unexpected. Linux; the kinds with a disk of their own need root, and are said to be left out else.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 101))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("GPIS_GRASP_STORE", "off")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmark_report import add_report_option, report
from fault_kinds import FAULTS, READ_LIMIT_S, Cell, Fault, fresh
from live_node import LiveNode, NodeClient, plan_request

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.catalogue import default_catalogue_directory

GOOD_BUDGET_S, SERVED_S = 1.5, 3.0
SMALL_DISK = 'mount -t tmpfs -o size=64k{} tmpfs "$0" && exec "$@"'
PARAMETERS = {
    "mesh_read_limit_s": str(READ_LIMIT_S),
    "default_verification": "none",
    "default_planner": "hpp",
}


class Row:
    """What came of one kind of fault."""

    def __init__(self, name: str, expected: frozenset[int]) -> None:
        self.name, self.expected = name, expected
        self.codes: Counter[str] = Counter()
        self.wrong: list[str] = []
        self.served_s: list[float] = []

    def take(self, k: int, answers: list[Any]) -> None:
        for answer in answers:
            if answer is None:
                self.wrong.append(f"run {k}: no answer")
                continue
            self.codes[ErrorCode(answer.code).name] += 1
            if answer.code not in self.expected:
                self.wrong.append(f"run {k}: {ErrorCode(answer.code).name}: {answer.message}")

    def good_request(self, k: int, client: NodeClient) -> None:
        start = time.monotonic()
        rng = random.Random(f"{self.name}/{k}/good")
        answer = client.call(fresh(rng, time_budget=GOOD_BUDGET_S))
        self.served_s.append(time.monotonic() - start)
        if answer is None or not answer.success:
            text = "no answer" if answer is None else answer.message
            self.wrong.append(f"run {k}: the good request: {text}")
        elif self.served_s[-1] > SERVED_S:
            self.wrong.append(f"run {k}: the good request after {self.served_s[-1]:.1f} s")

    def print(self) -> None:
        codes = ", ".join(f"{name} {n}" for name, n in sorted(self.codes.items())) or "-"
        served = sorted(self.served_s)
        times = f"{served[len(served) // 2]:.2f}, {served[-1]:.2f} s" if served else "-"
        print(f"| {self.name} | {codes} | {len(self.wrong)} | {times} |", flush=True)


def run(cell: Cell, fault: Fault, times: int) -> Row:
    """Do the harm of one kind some times."""
    row = Row(fault.name, fault.expected)
    for k in range(times):
        row.take(k, fault.harm(cell, random.Random(f"{fault.name}/{k}")))
        row.good_request(k, cell.client)
    row.print()
    return row


def environments(folder: Path) -> dict[str, tuple[dict[str, str], list[str]]]:
    """Kinds that a node is started in: variables of its environment, words before its command."""
    disk = folder / "disk"
    disk.mkdir()
    shell = ["unshare", "-m", "sh", "-c"]
    cache = {"GPIS_GRASP_CACHE": str(disk / "cache")}
    kinds: dict[str, tuple[dict[str, str], list[str]]] = {
        "no home": ({"HOME": "/proc/none", "XDG_CACHE_HOME": "/proc/none", **cache}, [])
    }
    if subprocess.run(["unshare", "-m", "true"], capture_output=True).returncode == 0:
        kinds["disk cache full"] = (cache, [*shell, SMALL_DISK.format(""), str(disk)])
        kinds["disk cache read-only"] = (cache, [*shell, SMALL_DISK.format(",ro"), str(disk)])
    else:
        print("| disk cache full, read-only | left out: unshare -m is not allowed here | | |")
    return kinds


def run_in(
    name: str, variables: dict[str, str], before: list[str], folder: Path, times: int
) -> Row:
    """Start a node in an environment some times, and have it plan on a part of its own."""
    row = Row(name, frozenset({ErrorCode.SUCCESS}))
    for k in range(times):
        namespace = f"/cell{len(list(folder.iterdir()))}"
        parts = make_catalogue(folder / namespace[1:])
        node = LiveNode(
            parts / "node.log",
            {**PARAMETERS, "mesh_directories": f"[{parts}]"},
            namespace,
            {**os.environ, **variables},
            before,
        )
        with node, NodeClient("client", namespace) as client:
            cell = Cell(node, client, parts, parts)
            with cell.part(random.Random(f"{name}/{k}")) as (mesh_id, _):
                row.take(k, [client.call(plan_request(mesh_id, time_budget=4.0))])
            row.good_request(k, client)
        check_log(node, row)
    row.print()
    return row


def check_log(node: LiveNode, row: Row) -> None:
    """Nothing that failed unexpectedly may stand in the log."""
    for sign in ("Traceback", "In the executor"):
        if n := node.text().count(sign):
            row.wrong.append(f"log: {n} times '{sign}' in {node.log}")


def make_catalogue(folder: Path) -> Path:
    """A folder with mug and sphere."""
    folder.mkdir()
    for name in ("mug.stl", "mug.yaml", "sphere.stl", "sphere.yaml"):
        shutil.copy(default_catalogue_directory() / name, folder)
    return folder


def main() -> int:
    """Print the table and what was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=20, help="of each kind (20)")
    parser.add_argument("--only", default="", help="kinds with this text in their name")
    add_report_option(parser, "faults.md")
    options = parser.parse_args()
    with report(options.report, "Faults on a live node"):
        return do_harm(options)


def do_harm(options: argparse.Namespace) -> int:
    """Do the harm of every kind; 1 where anything was unexpected."""
    folder = Path(tempfile.mkdtemp(prefix="gpis_faults_"))
    parts, cache = make_catalogue(folder / "parts"), folder / "cache"
    environment = {**os.environ, "GPIS_GRASP_CACHE": str(cache)}
    parameters = {**PARAMETERS, "mesh_directories": f"[{parts}]"}
    print("| kind | answers | unexpected | next good answer: median, longest |\n|---|---|---|---|")
    rows = []
    node = LiveNode(folder / "node.log", parameters, environment=environment)
    with node, NodeClient("faults") as client:
        cell = Cell(node, client, parts, cache)
        first = Row("none", frozenset({ErrorCode.SUCCESS}))
        while not (answer := client.call(fresh(random.Random(0)))) or not answer.success:
            time.sleep(0.1)
        first.good_request(0, client)
        first.print()
        rows = [run(cell, f, options.times) for f in FAULTS if options.only in f.name]
    check_log(node, first)
    for name, (variables, before) in environments(folder).items():
        if options.only in name:
            rows.append(run_in(name, variables, before, folder, options.times))
    wrong = [f"{row.name}: {text}" for row in [first, *rows] for text in row.wrong]
    print(f"\n{len(rows)} kinds, {options.times} times each; {len(wrong)} unexpected")
    print("\n".join(wrong))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
