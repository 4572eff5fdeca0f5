"""How far parts on a table go while the hand closes: of the first and of all answered grasps.

    python tests/benchmarks/closing_study.py --out closing --version present --objects HARD --each 5
    python tests/benchmarks/closing_study.py --out closing --report

Each part lies in its most probable resting pose, free, under gravity, with its own mass and a
friction of 0.4 to the table; the hand closes from the answered pre-grasp (MuJoCo). Rows are
appended to `OUT/cases.jsonl`; what stands there is not made again. `--held` asks for trials.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from resting_poses import place_at_rest

from gpis_grasp_benchmark.shares import Share
from gpis_grasp_benchmark.study_objects import collect
from gpis_grasp_planner.errors import GraspPlannerError
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.plan.warm_up import load_compiled
from gpis_grasp_planner.surroundings.pregrasp import arrival_spread_s
from gpis_grasp_planner.verification.cases import cad_mass
from gpis_grasp_planner.verification.protocol import Verifier, prepare
from gpis_grasp_planner.verification.settings import VerificationSettings
from gpis_grasp_planner.verification.table_closing import closing_motion

TABLE_FRICTION = 0.4
FAR_M = 0.005


def main() -> None:
    """Plan and measure, or report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the study")
    parser.add_argument("--version", default="present", help="name of what plans")
    parser.add_argument("--objects", type=Path, nargs="*", default=[Path("shipped")])
    parser.add_argument("--each", type=int, default=1, help="every n-th part alone")
    parser.add_argument("--seconds", type=float, default=5.0, help="budget; default 5")
    parser.add_argument("--set", nargs="*", default=[], help="settings, group.name=value")
    parser.add_argument("--report", action="store_true", help="only write the tables")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    if not arguments.report:
        measure(arguments)
    print(report(arguments.out / "cases.jsonl"))


def measure(arguments):
    """Append the cases that are missing."""
    file = arguments.out / "cases.jsonl"
    done = {(row["version"], row["part"]) for row in read(file)}
    parts = collect(arguments.objects, (), None, 0, 0).parts
    load_compiled()
    planner = GraspPlanner(settings_of(arguments.set))
    for name in sorted(parts)[:: arguments.each]:
        if (arguments.version, name) in done:
            continue
        row = {"version": arguments.version, "part": name, **case(planner, parts[name], arguments)}
        with file.open("a") as out:
            out.write(json.dumps(row) + "\n")
        print(row, flush=True)


def settings_of(assignments):
    """Settings of texts such as `clearance.pregrasp=narrow`."""
    groups = {}
    for text in assignments:
        name, value = text.split("=", 1)
        group, key = name.split(".")
        groups.setdefault(group, {})[key] = (
            json.loads(value) if value[0] in "-0123456789" else value
        )
    return PlannerSettings.from_mapping(groups)


def case(planner, part, arguments):
    """Code, and how far the part goes for the grasps answered, the first one first."""
    place = place_at_rest(part, "table")
    request = PlanRequest(time_budget_s=arguments.seconds, seed=0, verification="rank", n_grasps=10)
    start = time.monotonic()
    try:
        result = planner.answer(part, request, place).result
    except GraspPlannerError as error:
        return {"code": error.code.name, "moved_m": [], "elapsed_s": time.monotonic() - start}
    elapsed_s = round(time.monotonic() - start, 2)
    settings = VerificationSettings()
    settings = replace(settings, engine="mujoco", mass_kg=cad_mass(part, settings))
    prepared, moved = planner.prepare(part), []
    support = place.around().support
    with Verifier(
        part, planner.hand, settings, prepare(part, settings, prepared.field, prepared.tree)
    ) as verifier:
        for grasp in result.grasps:
            motion = closing_motion(verifier, grasp, support.point, support.normal, TABLE_FRICTION)
            moved.append(
                {
                    "m": None if motion is None else motion.slip_m,
                    "rad": None if motion is None else motion.rotation_rad,
                    "arrival_s": arrival_spread_s(planner.hand, grasp),
                    "imbalance": grasp.imbalance,
                    "epsilon": grasp.epsilon,
                    "palm": bool(
                        planner.hand.link_names.index(planner.hand.palm_link)
                        in grasp.contacts.links
                    ),
                    "held": None if grasp.trials is None else grasp.trials.held,
                    "gap_m": gap_below(part, grasp, support),
                }
            )
    return {"code": result.code.name, "moved": moved, "elapsed_s": elapsed_s, "mass": part.mass}


def gap_below(part, grasp, support):
    """Height of the lowest contact over the support, as a share of the part's [m]."""
    heights = (grasp.contacts.positions - support.point) @ support.normal
    return float(heights.min())


def read(file):
    """Rows of a file of JSON lines."""
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def report(file):
    """Median, 95th percentile and the share below 5 mm, by version."""
    lines = [
        "| version | parts answered | first: median, 95 % [mm] | below 5 mm | all grasps: median |"
    ]
    lines.append("|---|---|---|---|---|")
    rows = read(file)
    for version in dict.fromkeys(row["version"] for row in rows):
        answered = [row for row in rows if row["version"] == version and row.get("moved")]
        first = np.array([moved_m(row["moved"][0]) for row in answered])
        every = np.array([moved_m(one) for row in answered for one in row["moved"]])
        if not len(first):
            continue
        below = Share.of((first < FAR_M).tolist())
        low, high = below.interval
        lines.append(
            f"| {version} | {len(first)} | {1e3 * np.median(first):.1f}, "
            f"{1e3 * np.quantile(first, 0.95):.1f} | {below.passed} of {below.n} "
            f"({low:.0%}-{high:.0%}) | {1e3 * np.median(every):.1f} |"
        )
    return "\n".join(lines)


def moved_m(one):
    """How far; what was not closed on in time counts as lost."""
    return 1.0 if one["m"] is None else one["m"]


if __name__ == "__main__":
    main()
