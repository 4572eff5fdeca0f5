"""What proposals that begin with the contacts buy, by class of parts: shares side by side.

    python -m gpis_grasp_benchmark.parts.hard DIR
    python tests/benchmarks/contacts_ablation.py --objects DIR --shares 0,0.3 --out out/contacts

Each part is searched with every share, for equal processor time and with the same seeds, in free
space and on a table in its most probable pose; nothing is tried in physics. What counts is the
search's list: distinct grasps with force closure, and the mean epsilon of the best 20 (a missing
one counts as 0).
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

TESTS = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(TESTS))

from resting_poses import resting_poses  # noqa: E402

from gpis_grasp_benchmark.markdown import table  # noqa: E402
from gpis_grasp_benchmark.parts.hard import class_of  # noqa: E402
from gpis_grasp_benchmark.study_objects import collect  # noqa: E402
from gpis_grasp_planner.grasp.constrained_evaluator import ConstrainedEvaluator  # noqa: E402
from gpis_grasp_planner.plan.closing_balance import with_balance  # noqa: E402
from gpis_grasp_planner.plan.constraints import make_constraints  # noqa: E402
from gpis_grasp_planner.plan.planner import GraspPlanner  # noqa: E402
from gpis_grasp_planner.plan.request import PlanRequest  # noqa: E402
from gpis_grasp_planner.plan.warm_up import load_compiled  # noqa: E402
from gpis_grasp_planner.quality.objective import EpsilonVolume  # noqa: E402
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator  # noqa: E402
from gpis_grasp_planner.search.archive import GraspArchive  # noqa: E402
from gpis_grasp_planner.search.context import PlanningContext  # noqa: E402
from gpis_grasp_planner.search.searches import make_search  # noqa: E402
from gpis_grasp_planner.surroundings.obstacles import SupportPlane, Surroundings  # noqa: E402
from gpis_grasp_planner.surroundings.place import Place  # noqa: E402

LISTED = 20
MOST = 150
PLACES = ("free", "table")


def on_table(part):
    """The part's place in its most probable resting pose."""
    pose = resting_poses(part.mesh.vertices, part.center_of_mass)[0]
    height = float((part.mesh.vertices @ pose.up).min())
    return Place(surroundings=Surroundings(SupportPlane(pose.up * height, pose.up)))


def run(planner, part, place_name, settings, seed, seconds):
    """One search: its figures after equal processor time."""
    request = PlanRequest(seed=seed)
    friction = request.friction_for(part.friction)
    prepared = planner.prepare(part)
    hand, scene = planner.hand, settings.scene
    compiled = CompiledEvaluator(hand, part, friction, scene, prepared.field, prepared.tree)
    place = on_table(part) if place_name == "table" else Place()
    constraints = make_constraints(hand, request, place, settings)
    constrained = ConstrainedEvaluator(compiled, hand, constraints, scene.retreat_m)
    evaluator = with_balance(constrained, hand, part, settings)
    archive = GraspArchive(part.max_radius, EpsilonVolume(settings.hpp.volume_weight))
    context = PlanningContext(
        part=part,
        hand=hand,
        evaluator=evaluator,
        atlas=prepared.atlas,
        archive=archive,
        settings=settings.search,
        rng=np.random.default_rng(seed),
        constraints=constraints,
    )
    search = make_search(request.planner, context)
    end = time.process_time() + seconds
    while time.process_time() < end and not search.finished:
        search.step()
    listed = archive.best(MOST)
    epsilon = sorted((c.epsilon for c in listed[:LISTED]), reverse=True)
    return {
        "distinct": len(listed),
        "mean_epsilon": sum(epsilon) / LISTED,
        "best_epsilon": max(epsilon, default=0.0),
        "attempts": evaluator.n_attempts,
    }


def report(rows, arguments, words):
    """Markdown: one table per place, by class, first share against the others."""
    shares = arguments.shares
    lines = [
        "# Proposals that begin with the contacts",
        "",
        f"    python tests/benchmarks/contacts_ablation.py {words}",
        "",
        f"{arguments.seconds:g} s of processor time a search, {arguments.seeds} seeds, load "
        f"{os.getloadavg()[0]:.1f} at the end. Distinct force-closure grasps (at most {MOST}), "
        f"mean epsilon of the best {LISTED} (a missing one is 0), share of parts with at least ten "
        "distinct grasps.",
        "",
    ]
    for place in arguments.places:
        own = [row for row in rows if row["place"] == place]
        heading = ["class", "parts", *(f"distinct {s:g}" for s in shares)]
        heading += [f"mean epsilon {s:g}" for s in shares] + [f"ten {s:g}" for s in shares]
        body = []
        for name in [*sorted({row["class"] for row in own}), "all"]:
            of = [row for row in own if name in (row["class"], "all")]
            by = [[r for r in of if r["share"] == s] for s in shares]
            cells = [name, str(len({r["part"] for r in of}))]
            cells += [f"{np.mean([r['distinct'] for r in part]):.1f}" for part in by]
            cells += [f"{np.mean([r['mean_epsilon'] for r in part]):.4f}" for part in by]
            cells += [f"{np.mean([r['distinct'] >= 10 for r in part]):.2f}" for part in by]
            body.append(cells)
        lines += [f"## {place}", "", table(heading, body), ""]
    return "\n".join(lines)


def main():
    """Run what is asked for and write the rows and the report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--objects", type=Path, action="append", required=True)
    parser.add_argument("--facts", help="'graspit' for the original simulator's objects")
    parser.add_argument("--only", nargs="*", default=[], help="IDs")
    parser.add_argument("--per-class", type=int, help="so many parts of each class at most")
    parser.add_argument("--shares", type=lambda t: [float(x) for x in t.split(",")], default=[0.0])
    parser.add_argument("--places", nargs="*", default=list(PLACES), choices=PLACES)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--set", action="append", default=[], help="contacts.NAME=VALUE")
    parser.add_argument("--out", type=Path, default=Path("out/contacts"))
    arguments = parser.parse_args()
    from gpis_grasp_benchmark.reference import facts_of
    from gpis_grasp_planner.cli.options import read_settings

    base, _ = read_settings(None, arguments.set)
    facts = facts_of(arguments.facts)
    parts = collect(arguments.objects, arguments.only, facts, None, 0).parts
    load_compiled()
    planner, rows, taken = GraspPlanner(), [], {}
    for part_id, part in parts.items():
        group = class_of(part_id) if "_" in part_id else "original"
        taken[group] = taken.get(group, 0) + 1
        if arguments.per_class and taken[group] > arguments.per_class:
            continue
        for place in arguments.places:
            for seed in range(arguments.seeds):
                for share in arguments.shares:
                    contacts = replace(base.contacts, share=share)
                    settings = replace(base, contacts=contacts)
                    figures = run(planner, part, place, settings, seed, arguments.seconds)
                    rows.append(
                        {"part": part_id, "class": group, "place": place, "seed": seed,
                         "share": share, **figures}
                    )  # fmt: skip
                    print(json.dumps(rows[-1]), flush=True)
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "rows.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    words = " ".join(Path(w).name if w.startswith("/") else w for w in sys.argv[1:])
    text = report(rows, arguments, words)
    (arguments.out / "report.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
