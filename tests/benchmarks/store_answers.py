"""How long the node's planning process takes to answer from the grasp store, and where it goes.

    python tests/benchmarks/store_answers.py --former CHECKOUT

The mesh is known to the process, the plan is not in its memory: each answer is read from the file.
Processor times are told beside those of the clock: they hold on a loaded machine, too. `--others`
fills the store with further plans. With `--former` the same orders go to a former checkout's
sources, in turns with ours, five rounds each.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from gpis_grasp_planner.forked_child import usable_cores
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.plan.warm_up import load_compiled
from gpis_grasp_planner.ros.worker.messages import PlanOrder
from gpis_grasp_planner.ros.worker.order_handler import OrderHandler
from gpis_grasp_planner.store.conditions import Conditions
from gpis_grasp_planner.store.grasp_store import GraspStore
from gpis_grasp_planner.store.record import Record

ROUNDS = 5
SOURCE = Path("ros2_ws") / "src" / "gpis_grasp_planner"


def silent(_):
    """Take no progress."""


def orders_of(path, seconds):
    """Orders for the mug, in free space and on a table, answered from the store at `path`."""
    settings = PlannerSettings.from_mapping({"store": {"path": str(path)}})
    values = {"catalogue": CatalogueSettings().as_dict(), **settings.as_dict()}
    directory = default_catalogue_directory()
    lowest = float(MeshCatalogue([directory]).load("mug").mesh.bounds[0][2])
    request = PlanRequest(time_budget_s=seconds)
    free = PlanOrder("mug", (str(directory),), request, values)
    table = replace(free, place={"support": {"point": [0.0, 0.0, lowest]}})
    return {"free": free, "table": table}


def fill(path, n):
    """Keep `n` further plans like the first one, for other seeds."""
    store = GraspStore(path)
    record = store.record(store.entries()[0])
    conditions = record.conditions.as_mapping()
    many = []
    for seed in range(1000, 1000 + n):
        result = replace(record.result, request=replace(record.result.request, seed=seed))
        many.append((Record(result, Conditions.from_mapping({**conditions, "seed": seed})), 1.0))
    store.put_all(many)


def measure(folder, n, seconds, others):
    """Times [ms] of `n` answers to each order: of the clock, and of the processor."""
    path = Path(folder) / "grasps.sqlite"
    load_compiled()
    orders, handler = orders_of(path, seconds), OrderHandler()
    new = not path.exists()
    for order in orders.values():
        handler.make_plan(order, silent)
    if new and others:
        fill(path, others)
    found = {}
    for name, order in orders.items():
        clock, processor = [], []
        for _ in range(n):
            start, busy = time.perf_counter(), time.process_time()
            plan = handler.make_plan(order, silent)
            clock.append(1e3 * (time.perf_counter() - start))
            processor.append(1e3 * (time.process_time() - busy))
            if not plan.from_store:
                raise RuntimeError(f"{name}: {plan.message}")
            note = getattr(handler, "note_uses", None)
            if note is not None:  # after the answer, as the process does
                note()
        found[name] = {"clock": clock, "processor": processor, "grasps": len(plan.grasps)}
    return found


def in_turns(sources, arguments):
    """The times of each checkout's sources, by name and order."""
    found = {name: {} for name in sources}
    with tempfile.TemporaryDirectory() as folder:
        for number in range(ROUNDS + 1):
            for name, source in sources.items():
                own = Path(folder) / name
                own.mkdir(exist_ok=True)
                command = [sys.executable, __file__, "--folder", str(own)]
                command += ["--answers", str(arguments.answers), "--others", str(arguments.others)]
                command += ["--seconds", str(arguments.seconds)]
                run = subprocess.run(
                    command,
                    env={**os.environ, "PYTHONPATH": str(source)},
                    capture_output=True,
                    text=True,
                    check=False,
                )
                if run.returncode:
                    raise RuntimeError(run.stderr)
                if number:  # the first one plans
                    for order, times in json.loads(run.stdout).items():
                        row = found[name].setdefault(order, {"clock": [], "processor": []})
                        row["clock"] += times["clock"]
                        row["processor"] += times["processor"]
                        row["grasps"] = times["grasps"]
    return found


def table_of(found):
    """Markdown of the times."""
    lines = [
        "| sources | place | grasps | clock: median, 95 % | processor: median, 95 % |",
        "|---|---|---|---|---|",
    ]
    for name, orders in found.items():
        for order, row in orders.items():
            cells = []
            for kind in ("clock", "processor"):
                times = sorted(row[kind])
                high = times[min(len(times) - 1, int(0.95 * len(times)))]
                cells.append(f"{statistics.median(times):.1f}, {high:.1f} ms")
            lines.append(f"| {name} | {order} | {row['grasps']} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--former", type=Path, help="checkout of a former version to compare with")
    parser.add_argument("--answers", type=int, default=20, help="of each order and round")
    parser.add_argument("--others", type=int, default=1000, help="further plans in the store")
    parser.add_argument("--seconds", type=float, default=10.0, help="budget of the kept plans")
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.folder is not None:
        found = measure(arguments.folder, arguments.answers, arguments.seconds, arguments.others)
        print(json.dumps(found))
        return
    sources = {} if arguments.former is None else {"former": arguments.former / SOURCE}
    sources["present"] = Path(__file__).resolve().parents[2] / SOURCE
    print(table_of(in_turns(sources, arguments)))
    load = os.getloadavg()[0]
    print(
        f"\n{ROUNDS * arguments.answers} answers each, {arguments.others} further plans in the "
        f"store; {usable_cores()} cores, load {load:.1f}."
    )


if __name__ == "__main__":
    main()
