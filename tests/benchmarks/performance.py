"""Where the time of a plan goes, phase by phase, over the shipped parts: for docs/performance.md.

    python tests/benchmarks/performance.py
    python tests/benchmarks/performance.py --write

Processor time on one core, of one plan of a number of attempts and the trials of its five best
grasps, each part in a process of its own. What `stages.py` times as one, an attempt, is taken
apart by the shares of its phases (`attempt_phases.py`).
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path

import numpy as np
import stages
from recorded_attempts import recording

PAGE = Path(__file__).resolve().parents[2] / "docs" / "performance.md"
TABLE = ("<!-- profile: made by tests/benchmarks/performance.py -->", "<!-- /profile -->")
# Phase of the table, and the stages of `stages.py` that are in it.
PHASES = (
    ("reading a mesh file", ("read a mesh file",)),
    ("judging the mesh", ("judge the mesh",)),
    ("surface (GPIS)", ("surface (GPIS)",)),
    ("distance field, triangle tree", ("distance field", "triangle tree")),
    ("model: fit", ("model: fit",)),
    ("model: acquisition", ("model: acquisition",)),
    ("palms out of collision", ("palms out of collision",)),
    ("attempts", ("close, contacts, epsilon", "the same from a posture")),
    ("closing balance", ("closing balance",)),
    ("charts, contacts first, list", ("settle on a chart", "contacts first", "list of grasps")),
    ("finishing grasps", ("finish grasps",)),
    ("cover by convex pieces", ("cover by convex pieces",)),
    ("trials in physics", ("trial in physics",)),
    ("the rest", (stages.WHOLE,)),
)
_ATTEMPTS = "attempts"
_RATE = "attempts a second"
_EVERY = 3  # hand is closed again for the phases of an attempt


def measure(part_id: str, attempts: int) -> dict[str, float]:
    """Seconds by phase for one part, in this process, and the number of attempts."""
    import attempt_phases

    from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator

    with recording(CompiledEvaluator) as recorded:
        spent = stages.measure(part_id, attempts)
    evaluator = recorded[0][0]
    T = np.concatenate([one for _, one, _ in recorded])[::_EVERY]
    start = np.concatenate([one for _, _, one in recorded])[::_EVERY]
    of_attempts = attempt_phases.seconds(evaluator, T, start)
    alone = sum(of_attempts.values())
    found: dict[str, float] = {"made": spent["attempts"]}
    for phase, names in PHASES:
        seconds = sum(spent.get(name, 0.0) for name in names)
        if phase != _ATTEMPTS:
            found[phase] = seconds
            continue
        found[_RATE] = spent["attempts"] / seconds
        for name, of_phase in of_attempts.items():
            found[f"attempt: {name}"] = seconds * of_phase / alone
    return found


def table(runs: dict[str, dict[str, float]]) -> list[str]:
    """Markdown: milliseconds in the mean of the parts, the least and the most part, shares."""
    names = [n for n in next(iter(runs.values())) if n not in ("made", _RATE)]
    total = sum(run[n] for run in runs.values() for n in names)
    rows = ["| phase | ms | of the parts | share |", "|---|---|---|---|"]
    for name in names:
        each = [1e3 * run[name] for run in runs.values()]
        share = 100 * sum(each) / (1e3 * total)
        rows.append(
            f"| {name} | {statistics.mean(each):.1f} | {min(each):.1f} to {max(each):.1f} | "
            f"{share:.1f} % |"
        )
    rate = [run[_RATE] for run in runs.values()]
    made = statistics.mean(run["made"] for run in runs.values())
    return [
        *rows,
        "",
        f"{len(runs)} parts, {made:.0f} attempts each: {len(rate) / sum(1 / r for r in rate):.0f} "
        f"attempts a second of processor time within the plan ({min(rate):.0f} to "
        f"{max(rate):.0f} by part).",
    ]


def write_between(page: Path, marks: tuple[str, str], lines: list[str]) -> None:
    """Put lines between two marks of a page."""
    text = page.read_text()
    before, _, rest = text.partition(marks[0])
    _, _, after = rest.partition(marks[1])
    page.write_text("\n".join([before + marks[0], "", *lines, "", marks[1] + after]))


def main() -> None:
    """Measure every part and print the table; with --write also put it into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--parts", nargs="+", help="IDs of shipped parts; default: all")
    parser.add_argument("--attempts", type=int, default=1000)
    parser.add_argument("--write", action="store_true", help="put the table into the page")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        print(json.dumps(measure(arguments.one, arguments.attempts)))
        return
    from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory

    parts = arguments.parts or MeshCatalogue([default_catalogue_directory()]).ids()
    runs = {}
    for part_id in parts:
        command = [sys.executable, __file__, "--one", part_id]
        command += ["--attempts", str(arguments.attempts)]
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        done = subprocess.run(command, env=environment, capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"The measurement of {part_id} failed:\n{done.stderr}")
        runs[part_id] = json.loads(done.stdout.splitlines()[-1])
        print(f"{part_id}: done", file=sys.stderr)
    lines = table(runs)
    print("\n".join(lines))
    if arguments.write:
        write_between(PAGE, TABLE, lines)


if __name__ == "__main__":
    main()
