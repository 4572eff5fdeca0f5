"""How long answers take against their time budget: free and on a table, with trials and without.

    python tests/benchmarks/deadline.py --out deadline --bullet 7 --budgets 1 3
    python tests/benchmarks/deadline.py --out deadline --bullet 7 --budgets 1 3 --busy 2

Each case is answered in a process that is warm as the node is: cold (nothing known of the mesh,
the cache off), then warm (the same planner again). With `--busy N` so many processes compute
beside it all the time. `--fine N` adds a part of so many triangles. Appends to
`OUT/answers.jsonl`; what stands there is not made again. `OUT/tables.md` is of all that there is.
"""

from __future__ import annotations

import argparse
import itertools
import json
import multiprocessing
import os
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import trimesh

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fresh_child import in_fresh_child
from resting_poses import resting_poses

from gpis_grasp_benchmark.shares import Share
from gpis_grasp_benchmark.study_objects import collect
from gpis_grasp_planner.errors import GraspPlannerError
from gpis_grasp_planner.geometry.catalogue import load_part
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.warm_up import load_compiled
from gpis_grasp_planner.surroundings.obstacles import SupportPlane, Surroundings
from gpis_grasp_planner.surroundings.place import Place

PLACES = ("free", "table")
VERIFICATIONS = ("none", "rank")
STATES = ("cold", "warm")


def first_of(result):
    """What is known of the grasp that stands first."""
    if not result.grasps:
        return "none"
    trials = result.grasps[0].trials
    return "untried" if trials is None else "held" if trials.held else "failed"


def answers_of(part, place, request):
    """In a process of its own: the answer to a mesh never seen, then the same again."""
    planner = GraspPlanner()
    rows = []
    for state in STATES:
        start = time.monotonic()
        try:
            result = planner.answer(part, request, place).result
            code, first, phases = result.code.name, first_of(result), dict(result.phase_s)
        except GraspPlannerError as error:
            code, first, phases = error.code.name, "none", {}
        spent = time.monotonic() - start
        row = {"state": state, "elapsed_s": spent, "code": code, "first": first, "phase_s": phases}
        rows.append(row)
    return rows


def compute():
    """Keep a core busy."""
    while True:
        sum(range(10_000))


@contextmanager
def busy(n):
    """So many processes that compute beside what is measured."""
    processes = [multiprocessing.get_context("spawn").Process(target=compute) for _ in range(n)]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.join()


def fine_part(part, n_triangles):
    """A part with its faces cut in four until there are so many."""
    mesh = trimesh.Trimesh(part.mesh.vertices, part.mesh.faces, process=False)
    while len(mesh.faces) < n_triangles:
        mesh = mesh.subdivide()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{part.mesh_id}_{len(mesh.faces)}.stl"
        mesh.export(file)
        return load_part(file, "m")


def measure(arguments, file):
    """All cases that are not in the file yet."""
    names = ("part", "budget_s", "place", "verification", "busy")
    done = {tuple(row[name] for name in names) for row in read(file)}
    objects = collect([Path("shipped"), *arguments.objects], (), None, arguments.bullet)
    parts = {k: p for k, p in objects.parts.items() if not arguments.parts or k in arguments.parts}
    if arguments.fine:
        fine = fine_part(next(iter(parts.values())), arguments.fine)
        parts[fine.mesh_id] = fine
    os.environ["GPIS_GRASP_CACHE"] = "off"
    load_compiled()
    for key in itertools.product(
        parts, arguments.budgets, PLACES, arguments.verify, [arguments.busy]
    ):
        if key in done:
            continue
        part_id, budget_s, where, verification, _ = key
        part = parts[part_id]
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


def limit_s(row):
    """What an answer may be late: 200 ms, or beside busy processes a tenth of the budget."""
    return 0.1 * row["budget_s"] if row["busy"] else 0.2


def report(rows):
    """Markdown of all rows."""
    lines = [
        "Elapsed minus budget in milliseconds; negative is early. The 99th percentile of fewer",
        "than 100 answers is the largest. On time: at most 200 ms over the budget on an idle",
        "machine, a tenth of it beside busy processes, with Wilson's 95 % interval.",
        "",
        "| busy | verification | place | mesh | budget | answers | median | 99th percentile | "
        "largest | on time | SUCCESS | first grasp held | first untried |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    keys = ("busy", "verification", "place", "state", "budget_s")
    values = [sorted({row[key] for row in rows}) for key in keys]
    groups = [*itertools.product(*values)]
    groups += [(n, "all", "all", "all", "all") for n in values[0]]
    for group in groups:
        mine = [
            row
            for row in rows
            if all(want in ("all", row[key]) for key, want in zip(keys, group, strict=True))
        ]
        if not mine:
            continue
        late = np.array([1e3 * (row["elapsed_s"] - row["budget_s"]) for row in mine])
        on_time = Share.of([1e-3 * t <= limit_s(row) for t, row in zip(late, mine, strict=True)])
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
            *(sum(row["code"] == "SUCCESS" for row in mine),),
            *(sum(row["first"] == first for row in mine) for first in ("held", "untried")),
        ]
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    lines += ["", "## Late, or without a grasp", ""]
    worst = [
        row
        for row in rows
        if row["elapsed_s"] - row["budget_s"] > limit_s(row) or row["code"] != "SUCCESS"
    ]
    for row in sorted(worst, key=lambda row: row["budget_s"] - row["elapsed_s"]):
        late = 1e3 * (row["elapsed_s"] - row["budget_s"])
        lines.append(
            f"- {row['part']}, {row['place']}, {row['verification']}, {row['state']}, "
            f"{row['busy']} busy, {row['budget_s']:g} s: {row['code']}, {late:+.0f} ms"
        )
    loads = [row["load"] for row in rows if not row["busy"]]
    if loads:
        lines += [
            "",
            f"Load of the idle machine before a case: {min(loads):.1f} to {max(loads):.1f}.",
        ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure what is missing and write the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the measurement")
    parser.add_argument("--parts", nargs="*", help="only these of all the parts")
    parser.add_argument("--objects", type=Path, nargs="*", default=[], help="folders of meshes")
    parser.add_argument("--bullet", type=int, help="so many random parts of PyBullet's data")
    parser.add_argument("--fine", type=int, help="and a part of so many triangles")
    parser.add_argument("--busy", type=int, default=0, help="processes that compute beside it")
    parser.add_argument("--verify", nargs="+", choices=VERIFICATIONS, default=VERIFICATIONS)
    parser.add_argument("--budgets", type=float, nargs="+", default=[1.0, 2.0, 5.0])
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    file = arguments.out / "answers.jsonl"
    with busy(arguments.busy):
        measure(arguments, file)
    (arguments.out / "tables.md").write_text(report(read(file)))


if __name__ == "__main__":
    main()
