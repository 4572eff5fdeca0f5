"""How long answers take against their time budget: free and on a table, with trials and without.

    python tests/benchmarks/deadline.py --out deadline --parts mug coupling_hub --budgets 1 2 5

Each case is answered in a process that is warm as the node is: cold (nothing known of the mesh,
the cache off), then warm (the same planner again). Appends to `OUT/answers.jsonl`; what stands
there is not made again. `OUT/tables.md` is of all that stand there.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fresh_child import in_fresh_child
from resting_poses import resting_poses

from gpis_grasp_benchmark.shares import Share
from gpis_grasp_planner.errors import GraspPlannerError
from gpis_grasp_planner.geometry.catalogue import (
    MeshCatalogue,
    default_catalogue_directory,
)
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.warm_up import load_compiled
from gpis_grasp_planner.surroundings.obstacles import SupportPlane, Surroundings
from gpis_grasp_planner.surroundings.place import Place

PLACES = ("free", "table")
VERIFICATIONS = ("none", "rank")
STATES = ("cold", "warm")


def answers_of(part, place, request):
    """In a process of its own: the answer to a mesh never seen, then the same again."""
    planner = GraspPlanner()
    rows = []
    for state in STATES:
        start = time.monotonic()
        try:
            result = planner.answer(part, request, place).result
            code, n_grasps = result.code.name, len(result.grasps)
        except GraspPlannerError as error:
            code, n_grasps = error.code.name, 0
        spent = time.monotonic() - start
        rows.append({"state": state, "elapsed_s": spent, "code": code, "n_grasps": n_grasps})
    return rows


def measure(arguments, file):
    """All cases that are not in the file yet."""
    names = ("part", "budget_s", "place", "verification")
    done = {tuple(row[name] for name in names) for row in read(file)}
    catalogue = MeshCatalogue([default_catalogue_directory()])
    os.environ["GPIS_GRASP_CACHE"] = "off"
    load_compiled()
    wanted = arguments.parts or catalogue.ids()
    for key in itertools.product(wanted, arguments.budgets, PLACES, VERIFICATIONS):
        if key in done:
            continue
        part_id, budget_s, where, verification = key
        part = catalogue.load(part_id)
        place = Place()
        if where == "table":
            up = resting_poses(part.mesh.vertices, part.center_of_mass)[0].up
            height = float((part.mesh.vertices @ up).min())
            place = Place(surroundings=Surroundings(SupportPlane(up * height, up)))
        request = PlanRequest(time_budget_s=budget_s, verification=verification)
        load = os.getloadavg()[0]
        for row in in_fresh_child(answers_of, part, place, request):
            row = dict(zip(names, key, strict=True)) | row | {"load": load}
            with file.open("a") as stream:
                stream.write(json.dumps(row) + "\n")
            late = row["elapsed_s"] - budget_s
            print(*key, row["state"], row["code"], f"{1e3 * late:+.0f} ms", flush=True)


def read(file):
    """The rows of a file; none where it is not there."""
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def report(rows):
    """Markdown of all rows."""
    lines = [
        "Elapsed minus budget in milliseconds; negative is early. The 99th percentile of fewer",
        "than 100 answers is the largest. On time: at most 100 ms over the budget, with Wilson's",
        "95 % interval. Usable: code SUCCESS.",
        "",
        "| verification | place | mesh | budget | answers | median | 99th percentile | largest | "
        "on time | usable |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    budgets = sorted({row["budget_s"] for row in rows})
    groups = [*itertools.product(VERIFICATIONS, PLACES, STATES, budgets), ("all",) * 4]
    for group in groups:
        keys = ("verification", "place", "state", "budget_s")
        mine = [
            row
            for row in rows
            if all(want in ("all", row[key]) for key, want in zip(keys, group, strict=True))
        ]
        if not mine:
            continue
        late = np.array([1e3 * (row["elapsed_s"] - row["budget_s"]) for row in mine])
        on_time = Share.of(list(late <= 100.0))
        low, high = on_time.interval
        *words, budget = group
        cells = [
            *words,
            budget if budget == "all" else f"{budget:g} s",
            len(mine),
            f"{np.median(late):+.0f}",
            f"{np.quantile(late, 0.99, method='higher'):+.0f}",
            f"{late.max():+.0f}",
            f"{on_time.passed} of {on_time.n} ({100 * low:.0f}-{100 * high:.0f} %)",
            f"{sum(row['code'] == 'SUCCESS' for row in mine)} of {len(mine)}",
        ]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    lines += ["", "## What falls short", ""]
    worst = [
        row for row in rows if row["elapsed_s"] - row["budget_s"] > 0.1 or row["code"] != "SUCCESS"
    ]
    for row in sorted(worst, key=lambda row: row["budget_s"] - row["elapsed_s"]):
        late = 1e3 * (row["elapsed_s"] - row["budget_s"])
        lines.append(
            f"- {row['part']}, {row['place']}, {row['verification']}, {row['state']}, "
            f"{row['budget_s']:g} s: {row['code']}, {late:+.0f} ms"
        )
    loads = [row["load"] for row in rows]
    if rows:
        lines += ["", f"Load of the machine before a case: {min(loads):.1f} to {max(loads):.1f}."]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure what is missing and write the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the measurement")
    parser.add_argument("--parts", nargs="*", help="mesh IDs; all shipped ones if none")
    parser.add_argument("--budgets", type=float, nargs="+", default=[1.0, 2.0, 5.0])
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    file = arguments.out / "answers.jsonl"
    measure(arguments, file)
    (arguments.out / "tables.md").write_text(report(read(file)))


if __name__ == "__main__":
    main()
