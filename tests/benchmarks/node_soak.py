"""A node under load: lost answers, BUSY, answers from memory, cancels, memory over many plans.

python tests/benchmarks/node_soak.py            # as the report asks for it, about an hour
python tests/benchmarks/node_soak.py --quick    # some minutes
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
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

import numpy as np
from benchmark_report import add_report_option, report
from live_node import LiveNode, children
from node_load import (
    LIMIT_S,
    MESHES,
    Clients,
    burst,
    cancels,
    covariances,
    in_processes,
    mix,
    request_for,
)

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory

QUICK = {"rounds": 3, "calls": 20, "cancels": 20, "plans": 40}
PARTS = ("busy", "cached", "covariances", "mix", "cancels", "plans")


def line(name: str, times: list[float]) -> str:
    """Median, 99th percentile and largest of times, in milliseconds."""
    if not times:
        return f"| {name} | none |"
    p50, p99 = np.percentile(1e3 * np.array(times), [50, 99])
    return f"| {name} | {len(times)}: {p50:.1f}, {p99:.1f}, {1e3 * max(times):.1f} ms |"


def memory_mb(pids: list[int]) -> float:
    """Proportional memory of processes [MB]; one that is gone counts nothing."""
    total = 0.0
    for pid in pids:
        try:
            text = Path(f"/proc/{pid}/smaps_rollup").read_text()
        except (FileNotFoundError, ProcessLookupError):
            continue
        pss = [row.split()[1] for row in text.splitlines() if row.startswith("Pss:")]
        total += sum(map(float, pss)) / 1024.0
    return total


def counts(pid: int) -> tuple[int, int, int]:
    """Threads, descriptors and children of a process."""
    status = Path(f"/proc/{pid}/status").read_text()
    threads = next(row.split()[1] for row in status.splitlines() if row.startswith("Threads"))
    return int(threads), len(list(Path(f"/proc/{pid}/fd").iterdir())), len(children(pid))


def main() -> None:
    """Print the table, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help=f"other defaults: {QUICK}")
    parser.add_argument("--clients", type=int, default=100, help="calling at once (100)")
    parser.add_argument("--rounds", type=int, default=10, help="of calls at once (10)")
    parser.add_argument("--calls", type=int, default=200, help="mixed, of each of 50 clients (200)")
    parser.add_argument("--cancels", type=int, default=200, help="goals to cancel (200)")
    parser.add_argument("--plans", type=int, default=1000, help="of mixed meshes (1000)")
    parser.add_argument("--processes", type=int, default=5, help="that the clients are in (5)")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, help="of the parts")
    add_report_option(parser, "soak.md")
    if parser.parse_known_args()[0].quick:
        parser.set_defaults(**QUICK)
    options = parser.parse_args()
    with report(options.report, "The node under load for long"):
        soak(options)


def soak(options: Any) -> None:
    """Start a node, put it under load, and print the table."""
    log = Path(tempfile.mkdtemp(prefix="gpis_soak_")) / "node.log"
    node = LiveNode(log, {})
    with node, Clients("soak", 1) as client:
        Soak(client, options, node.pid).print()
    text = log.read_text(errors="replace")
    print(f"| exit code; tracebacks in the log | {node.end()}; {text.count('Traceback')} |")


class Soak:
    """The rows of the table.

    Parameters
    ----------
    client : Clients
        One client of this process.
    options : Namespace
    pid : int
        Of the node.
    """

    def __init__(self, client: Clients, options: Any, pid: int) -> None:
        self._client, self._options, self._pid = client, options, pid

    def print(self) -> None:
        """Print the table."""
        for mesh_id in MESHES if "mix" in self._options.only else ("mug", "sphere"):
            answer = None
            while answer is None or answer.code not in (0, 400):
                answer, _ = self._client.call(0, request_for(mesh_id))
        print("| measure | number: median, 99th percentile, largest |\n|---|---|")
        before = counts(self._pid)
        for part in PARTS:
            if part in self._options.only:
                getattr(self, part)()
                sys.stdout.flush()
        print(f"| threads, descriptors, children before, after | {before}, {counts(self._pid)} |")

    def cached(self) -> None:
        times = [self._client.call(0, request_for("mug"))[1] for _ in range(500)]
        print(line("cached answer, nothing else", times))

    def covariances(self) -> None:
        end = time.time() + 30.0
        with multiprocessing.get_context("spawn").Pool(2) as pool:
            asked = pool.map_async(covariances, [(k, 6, end) for k in range(2)])
            time.sleep(8.0)
            beside = []
            while time.time() < end - 2.0:
                beside.append(self._client.call(0, request_for("mug"))[1])
                time.sleep(0.01)
            codes = sum(asked.get(LIMIT_S), Counter())
            pool.close()
            pool.join()  # as in `in_processes`
        print(line("cached answer beside 12 clients with covariances", beside))
        print(f"| their answers by code | {dict(codes)} |")

    def busy(self) -> None:
        options = self._options
        share = options.clients // options.processes
        begin = time.time() + 10.0 + 0.2 * share
        arguments = [(k, share, options.rounds, begin) for k in range(options.processes)]
        rows = in_processes(burst, arguments)
        codes = dict(Counter(row.code for row in rows))
        print(f"| {share * options.processes} at once, {options.rounds} rounds | {len(rows)} |")
        print(f"| of them lost; by code | {codes.get(-1, 0)}; {codes} |")
        busy = [row for row in rows if row.code == 500]
        print(line("BUSY: the node wrote it", [row.written_s for row in busy]))
        print(line("BUSY: the client's middleware had it", [row.arrived_s for row in busy]))

    def mix(self) -> None:
        options = self._options
        share = 50 // options.processes
        begin = time.time() + 10.0 + 0.2 * share
        arguments = [(k, share, options.calls, begin) for k in range(options.processes)]
        rows = in_processes(mix, arguments)
        codes = dict(Counter(code for code, _, _ in rows))
        print(f"| mixed calls of {share * options.processes} clients: answers | {len(rows)} |")
        print(f"| lost; crossed | {codes.get(-1, 0)}; {sum(bad for _, _, bad in rows)} |")
        print(f"| by code | {codes} |")
        print(line("refusals", [s for code, s, _ in rows if code in (101, 102)]))

    def cancels(self) -> None:
        print(line("cancel", cancels(self._options.cancels)))

    def plans(self) -> None:
        """Memory of node and planning process over many plans of all parts of the catalogue."""
        meshes = MeshCatalogue((default_catalogue_directory(),)).ids()
        samples = []
        for k in range(self._options.plans):
            mesh_id = meshes[k % len(meshes)]
            request = request_for(mesh_id, seed=k)
            request.verification = "rank" if k % 10 == 0 else "none"
            self._client.call(0, request)
            workers = children(self._pid)
            samples.append((k, memory_mb([self._pid]), memory_mb(workers)))
        n, of_node, of_worker = np.array(samples[len(samples) // 5 :]).T  # after warming up
        for name, values in (("node", of_node), ("planning process", of_worker)):
            slope = 100.0 * np.polyfit(n, values, 1)[0]
            print(
                f"| memory of the {name} over {len(samples)} plans of {len(meshes)} meshes | "
                f"{values[0]:.0f} to {values[-1]:.0f} MB, slope {slope:.2f} MB per 100 plans |"
            )


if __name__ == "__main__":
    main()
