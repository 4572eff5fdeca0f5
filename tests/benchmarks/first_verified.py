"""Time to the first grasp that held in physics: mesh new, mesh on disk, mesh in memory, shell.

    python tests/benchmarks/first_verified.py --out first --bullet 4
    python tests/benchmarks/first_verified.py --out first --no-parts --processes 5

Every part is planned for in free space in a process that is warm as the node is, until the first
trial has held: with an empty cache, then in another such process from the cache on disk, then
again in the same process. After that, whole processes from the shell: `gpis-grasp plan mug` until
its status line tells of a grasp that held, and the processor time of a plan without trials.
Appends to `OUT/parts.jsonl` and `OUT/processes.jsonl`; what stands there is not made again.
"""

from __future__ import annotations

import argparse
import json
import os
import pty
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fresh_child import in_fresh_child

from gpis_grasp_benchmark.shares import Share
from gpis_grasp_benchmark.study_objects import collect
from gpis_grasp_planner.errors import GraspPlannerError
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.progress import Monitor
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.warm_up import load_compiled

STATES = ("new", "disk", "memory")
HELD = re.compile(rb"[1-9]\d* of \d+ held in physics")
LONGEST_S = 60.0


def first_verified(planner, part, budget_s):
    """Seconds to the first grasp that held (None if none did), and to the first with closure."""
    seen = {}

    def look(progress):
        if progress.n_candidates:
            seen.setdefault("found_s", progress.elapsed_s)
        if progress.n_held:
            seen.setdefault("held_s", progress.elapsed_s)

    monitor = Monitor(budget_s, look, lambda: "held_s" in seen)
    request = PlanRequest(time_budget_s=budget_s, verification="rank")
    try:
        result = planner.answer(part, request, monitor=monitor).result
        code = result.code.name
    except GraspPlannerError as error:
        return {"code": error.code.name, "found_s": None, "held_s": None}
    if "held_s" not in seen and any(g.trials and g.trials.held for g in result.grasps):
        seen["held_s"] = monitor.elapsed_s  # with the answer itself
    return {"code": code, "found_s": seen.get("found_s"), "held_s": seen.get("held_s")}


def times_of(part, budget_s, again):
    """In a process of its own: once, or twice for a mesh that is in memory then."""
    planner = GraspPlanner()
    found = [first_verified(planner, part, budget_s)]
    return found + ([first_verified(planner, part, budget_s)] if again else [])


def measure_parts(arguments, file):
    """All parts in their three states."""
    done = {row["part"] for row in read(file)}
    objects = collect([Path("shipped"), *arguments.objects], (), None, arguments.bullet)
    load_compiled()
    for part_id, part in objects.parts.items():
        if part_id in done or (arguments.only and part_id not in arguments.only):
            continue
        load = os.getloadavg()[0]
        with tempfile.TemporaryDirectory() as cache:
            os.environ["GPIS_GRASP_CACHE"] = cache
            [new] = in_fresh_child(times_of, part, arguments.seconds, False)
            disk, memory = in_fresh_child(times_of, part, arguments.seconds, True)
            del os.environ["GPIS_GRASP_CACHE"]
        row = {"part": part_id, "set": objects.set_of[part_id], "load": load}
        row |= {"new": new, "disk": disk, "memory": memory, "triangles": len(part.mesh.faces)}
        append(file, row)
        print(part_id, {state: row[state]["held_s"] for state in STATES}, flush=True)


def wall_to_first_held(command):
    """Seconds from the start of a process to the status line that tells of a grasp that held."""
    ours, theirs = pty.openpty()
    environment = {**os.environ, "COLUMNS": "200", "TERM": "xterm"}
    start = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=theirs, env=environment)
    os.close(theirs)
    text, held_s = b"", None
    while time.monotonic() - start < LONGEST_S:
        try:
            more = os.read(ours, 4096)
        except OSError:  # the other end is closed
            break
        text += more
        if held_s is None and HELD.search(text):
            held_s = time.monotonic() - start
    os.close(ours)
    process.wait()
    return held_s, time.monotonic() - start


def computing_s():
    """Processor seconds of the children that were waited for, theirs included."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def measure_processes(n, file):
    """Whole processes from the shell."""
    program = [sys.executable, "-m", "gpis_grasp_planner.cli.main", "plan", "mug"]
    for number in range(len(read(file)), n):
        load = os.getloadavg()[0]
        held_s, wall_s = wall_to_first_held(program)
        before = computing_s()
        start = time.monotonic()
        subprocess.run(
            [*program, "--time", "1", "--verify", "none"], check=True, capture_output=True
        )
        row = {
            "number": number,
            "held_s": held_s,
            "wall_s": wall_s,
            "cpu_s": computing_s() - before,
            "plain_wall_s": time.monotonic() - start,
            "load": load,
        }
        append(file, row)
        print(row, flush=True)


def read(file):
    """The rows of a file; none where it is not there."""
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def append(file, row):
    """One more row."""
    with file.open("a") as stream:
        stream.write(json.dumps(row) + "\n")


def report(parts, processes, budget_s):
    """Markdown of all rows."""
    lines = [
        f"Times to the first grasp that held, in seconds; a part without one within {budget_s:g} s",
        "counts as later than all others in median and percentile. In brackets: Wilson's 95 %",
        "interval of the share.",
        "",
        "| mesh | parts | median | 95th percentile | slowest | held within 5 s | first grasp with "
        "force closure, median |",
        "|---|---|---|---|---|---|---|",
    ]
    for state in STATES:
        held = np.array([p[state]["held_s"] or np.inf for p in parts])
        found = np.array([p[state]["found_s"] or np.inf for p in parts])
        share = Share.of(list(held <= 5.0))
        low, high = share.interval
        cells = [
            {"new": "new", "disk": "on disk", "memory": "in memory"}[state],
            len(parts),
            f"{np.median(held):.2f}",
            f"{np.quantile(held, 0.95, method='higher'):.2f}",
            f"{held.max():.2f}",
            f"{share.passed} of {share.n} ({100 * low:.0f}-{100 * high:.0f} %)",
            f"{np.median(found):.2f}",
        ]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    lines += ["", "| whole process | runs | median | smallest | largest |", "|---|---|---|---|---|"]
    names = {
        "held_s": "`gpis-grasp plan mug`: start to first grasp that held, wall",
        "wall_s": "the same, start to exit, wall",
        "cpu_s": "`gpis-grasp plan mug --time 1 --verify none`: processor time",
        "plain_wall_s": "the same, start to exit, wall",
    }
    for name, text in names.items():
        values = np.array([row[name] for row in processes if row[name] is not None])
        if len(values):
            figures = f"{np.median(values):.2f} | {values.min():.2f} | {values.max():.2f}"
            lines.append(f"| {text} | {len(values)} | {figures} |")
    missed = [
        f"- {p['part']}, mesh {state}: {p[state]['code']}"
        for p in parts
        for state in STATES
        if p[state]["held_s"] is None
    ]
    lines += ["", "## What falls short", "", *(missed or ["No part without a grasp that held."])]
    lines += ["", "## Parts", "", "| part | set | triangles | new | on disk | in memory | load |"]
    lines.append("|---|---|---|---|---|---|---|")
    for p in parts:
        times = " | ".join(
            "-" if p[state]["held_s"] is None else f"{p[state]['held_s']:.2f}" for state in STATES
        )
        lines.append(f"| {p['part']} | {p['set']} | {p['triangles']} | {times} | {p['load']:.1f} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure what is missing and write the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the measurement")
    parser.add_argument("--objects", type=Path, nargs="*", default=[], help="folders of meshes")
    parser.add_argument("--bullet", type=int, help="random parts of PyBullet, and its household")
    parser.add_argument("--only", nargs="*", default=[], help="these parts alone")
    parser.add_argument("--no-parts", action="store_true", help="whole processes alone")
    parser.add_argument("--seconds", type=float, default=15.0, help="budget; default 15")
    parser.add_argument("--processes", type=int, default=5, help="whole processes; default 5")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    parts, processes = arguments.out / "parts.jsonl", arguments.out / "processes.jsonl"
    measure_processes(arguments.processes, processes)
    if not arguments.no_parts:
        measure_parts(arguments, parts)
    text = report(read(parts), read(processes), arguments.seconds)
    (arguments.out / "tables.md").write_text(text)


if __name__ == "__main__":
    main()
