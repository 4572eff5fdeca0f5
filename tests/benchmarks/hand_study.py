"""The hands side by side on the shipped parts: whether the first grasp answered holds.

    python tests/benchmarks/hand_study.py --out docs/benchmark/hands
    python tests/benchmarks/hand_study.py --hands parallel_jaw --time 10 --places free mug flange

plans with each hand on each part, in free space and, for some, where it lies on a table, tries the
first grasp again in both engines, appends a row each to `OUT/rows.jsonl`, and writes
`OUT/tables.md`. Without `--out` it prints. A part counts as one that a hand can span where its
smallest width is no more than the widest pinch of the hand's tables. Four hands take 7 minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from resting_poses import place_at_rest

from gpis_grasp_benchmark.shares import Share
from gpis_grasp_planner.errors import GraspPlannerError
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.hand.description import available_hands
from gpis_grasp_planner.hand.settings import HandSettings
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.plan.warm_up import load_compiled
from gpis_grasp_planner.search.contacts.grips import pinches
from gpis_grasp_planner.verification.protocol import verify
from gpis_grasp_planner.verification.settings import VerificationSettings

ENGINES = ("mujoco", "bullet")
PLACES = ("free", "table")
ON_TABLE = ("bracket", "coupling_hub", "housing", "mug")


def main() -> None:
    """Plan and try, a row each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hands", nargs="*", default=list(available_hands()))
    parser.add_argument("--places", nargs="*", choices=PLACES, default=list(PLACES))
    parser.add_argument("--time", type=float, default=5.0, help="budget of a plan [s]; default 5")
    parser.add_argument("--friction", type=float, default=0.6)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="folder of the study")
    parser.add_argument("parts", nargs="*")
    arguments = parser.parse_args()
    catalogue = MeshCatalogue([default_catalogue_directory()])
    load_compiled()
    rows = []
    for hand in arguments.hands:
        settings = PlannerSettings(hand=HandSettings(model=hand))
        planner = GraspPlanner(settings)
        for place in arguments.places:
            chosen = arguments.parts or (catalogue.ids() if place == "free" else ON_TABLE)
            for name in chosen:
                row = tried(planner, catalogue.load(name), place, arguments)
                print(json.dumps(row), flush=True)
                rows.append(row)
    text = tables(rows, arguments)
    print(text)
    if arguments.out is not None:
        arguments.out.mkdir(parents=True, exist_ok=True)
        lines = "".join(json.dumps(row) + "\n" for row in rows)
        (arguments.out / "rows.jsonl").write_text(lines)
        (arguments.out / "tables.md").write_text(text)


def tried(planner, part, place, arguments):
    """Plan once and try the first grasp again in both engines."""
    request = PlanRequest(
        time_budget_s=arguments.time,
        n_grasps=4,
        friction=Friction(arguments.friction, arguments.friction),
        seed=arguments.seed,
        verification="rank",
    )
    row = {
        "hand": planner.hand.yaml_path.stem,
        "part": part.mesh_id,
        "place": place,
        "widest_pinch_mm": 1e3 * widest_pinch(planner.hand),
        "smallest_width_mm": 1e3 * smallest_width(part.mesh.vertices),
    }
    try:
        where = place_at_rest(part) if place == "table" else None
        result = planner.answer(part, request, where).result
    except GraspPlannerError as error:
        return row | {"code": error.code.name, "grasps": 0}
    row |= {
        "code": result.code.name,
        "grasps": len(result.grasps),
        "attempts": result.evaluations,
        "elapsed_s": round(result.elapsed_s, 2),
    }
    if result.grasps:
        first = result.grasps[0]
        row |= {"epsilon": float(first.epsilon), "volume": float(first.volume)}
        for engine in ENGINES:
            settings = VerificationSettings(engine=engine, friction=arguments.friction)
            [verdict] = verify(part, planner.hand, [first], settings)
            row[engine] = verdict.cause or "held"
            row[f"{engine}_slip_mm"] = round(verdict.largest_slip_mm, 2)
    return row


def widest_pinch(hand) -> float:
    """Largest distance [m] of two sides of the hand that face each other."""
    return float(pinches(hand, 180.0).width[-1])


def smallest_width(vertices) -> float:
    """Smallest width [m] of points (n, 3) across a face of their hull."""
    hull = ConvexHull(vertices)
    heights = vertices[hull.vertices] @ hull.equations[:, :3].T
    return float(np.ptp(heights, axis=0).min())


def tables(rows, arguments) -> str:
    """The hands side by side, and every part with every hand."""
    of = defaultdict(list)
    for row in rows:
        of[row["hand"], row["place"]].append(row)
    load = os.getloadavg()[2]
    lines = [
        f"{arguments.time:g} s for a plan, friction {arguments.friction:g}, seed "
        f"{arguments.seed}; load of the machine over 15 minutes at the end {load:.1f}. Shares with "
        "Wilson's 95 %.\n",
        "| hand | place | spans | answered | MuJoCo | Bullet | both | median epsilon | per s |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for (hand, place), own in of.items():
        spanned = [r for r in own if r["smallest_width_mm"] <= r["widest_pinch_mm"]]
        first = [r for r in spanned if r["code"] == "SUCCESS" and "epsilon" in r]
        held = {e: [r for r in first if r[e] == "held"] for e in ENGINES}
        both = [r for r in held["mujoco"] if r["bullet"] == "held"]
        shares = [Share(len(x), len(spanned)) for x in (first, *held.values(), both)]
        epsilon = np.median([r["epsilon"] for r in first]) if first else float("nan")
        rate = np.median([r["attempts"] / r["elapsed_s"] for r in first]) if first else 0.0
        cells = [hand, place, f"{len(spanned)} of {len(own)}", *map(of_all, shares)]
        lines.append(f"| {' | '.join(cells)} | {epsilon:.3f} | {rate:.0f} |")
    lines += ["", "First grasps: epsilon, then MuJoCo and Bullet.", ""]
    hands = list(dict.fromkeys(r["hand"] for r in rows))
    lines += [f"| part, place | {' | '.join(hands)} |", "|---|" + "---|" * len(hands)]
    for name, place in dict.fromkeys((r["part"], r["place"]) for r in rows):
        cells = [
            next((cell(r) for r in of[hand, place] if r["part"] == name), "") for hand in hands
        ]
        lines.append(f"| {name}, {place} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def of_all(share: Share) -> str:
    """A share with its interval."""
    low, high = share.interval
    return f"{share.passed} of {share.n} ({low:.0%}-{high:.0%})"


def cell(row) -> str:
    """What came of one part with one hand."""
    if "epsilon" not in row:
        return row["code"]
    said = row["mujoco"] if row["mujoco"] == row["bullet"] else f"{row['mujoco']}, {row['bullet']}"
    missed = "" if row["code"] == "SUCCESS" else f" ({row['code']})"
    return f"{row['epsilon']:.3f} {said}{missed}"


if __name__ == "__main__":
    main()
