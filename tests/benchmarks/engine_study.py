"""Whether the physics engines agree over grasps, and the closing balance tells which hold.

    python tests/benchmarks/engine_study.py --out engines --bullet 20
    python tests/benchmarks/engine_study.py --out engines --bullet 20 --fine 3

Plans on every part, in free space and on a table, without trials, half of the time with and half
of it without the closing balance in the objective, and tries a spread of each answer's grasps by
the strict protocol in each engine, and of every `--fine`-th grasp also in each with steps of a
quarter. Appends a line per grasp to `OUT/grasps.jsonl`; cases that stand there are not made again.
`OUT/report.md` is of all that stand there.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.stats import mannwhitneyu, spearmanr

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from resting_poses import place_at_rest

from gpis_grasp_benchmark.shares import Share
from gpis_grasp_benchmark.study_objects import collect
from gpis_grasp_planner.errors import GraspPlannerError
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.plan.warm_up import load_compiled
from gpis_grasp_planner.quality.closing_balance import ClosingBalance
from gpis_grasp_planner.verification.engines import ENGINES
from gpis_grasp_planner.verification.protocol import Verifier, prepare
from gpis_grasp_planner.verification.settings import VerificationSettings

RANKS = (0, 1, 2, 4, 6, 9, 12, 16)
FINE = 4
EDGES = (0.0, 0.01, 0.1, 0.3, 1.0, 3.0, np.inf)


def imbalance_of(planner, part, grasp, settings):
    """By the contacts as they were planned, whatever the search asked."""
    balance = ClosingBalance(
        planner.hand,
        part.center_of_mass,
        part.max_radius,
        planner.settings.hpp.balance_friction_share or 0.67,
        settings.tip_force_n,
        settings.holding_force_n,
        settings.mass_kg * settings.acceleration_m_s2,
    )
    contacts = grasp.contacts
    return float(
        balance.imbalance(
            grasp.T_object_palm[None],
            grasp.joints[None],
            np.array([len(contacts)]),
            contacts.positions[None],
            contacts.normals_inward[None],
            contacts.friction[None],
            contacts.links[None].astype(np.int64),
        )[0]
    )


def verdict_row(verdict):
    """What is kept of a verdict."""
    return {
        "held": verdict.held,
        "cause": verdict.cause,
        "closing_slip_mm": round(1e3 * verdict.closing_slip_m, 3),
        "closing_turn_deg": round(float(np.degrees(verdict.closing_rotation_rad)), 2),
        "slip_mm": round(verdict.largest_slip_mm, 3),
        "turn_deg": round(verdict.largest_rotation_deg, 2),
        "elapsed_s": round(verdict.elapsed_s, 3),
    }


def case(planner, part, key, arguments, n_before):
    """Plan once and try a spread of the answer; rows of the file."""
    request = PlanRequest(time_budget_s=arguments.seconds, seed=arguments.seed, verification="none")
    try:
        grasps = planner.answer(part, request, place_at_rest(part, key["where"])).result.grasps
    except GraspPlannerError as error:
        return [{**key, "error": str(error)}]
    chosen = [(rank, grasps[rank]) for rank in RANKS if rank < len(grasps)]
    if not chosen:
        return [{**key, "error": "no grasp"}]
    friction = min(0.6, float(grasps[0].contacts.friction.max()))
    nominal = VerificationSettings(friction=friction)
    prepared = planner.prepare(part)
    pieces = prepare(part, nominal, prepared.field, prepared.tree)
    rows = [
        {
            **key,
            "rank": rank,
            "epsilon": grasp.epsilon,
            "imbalance": imbalance_of(planner, part, grasp, nominal),
            "friction": friction,
            "load": round(os.getloadavg()[0], 2),
        }
        for rank, grasp in chosen
    ]
    modes = {name: replace(nominal, engine=name) for name in ENGINES}
    finer = {
        "bullet": {"rate_hz": FINE * nominal.rate_hz},
        "mujoco": {"mujoco_rate_hz": FINE * nominal.mujoco_rate_hz},
    }
    for name, settings in list(modes.items()):
        modes[f"{name} fine"] = replace(settings, **finer[name])
    for name, settings in modes.items():
        with Verifier(part, planner.hand, settings, pieces) as verifier:
            for number, (row, (_, grasp)) in enumerate(zip(rows, chosen, strict=True)):
                fine = arguments.fine and (n_before + number) % arguments.fine == 0
                if fine or not name.endswith("fine"):
                    row[name] = verdict_row(verifier.verify(grasp))
    return rows


def run(arguments, file):
    """Make the cases that do not stand in the file yet."""
    rows = read(file)
    done = {(r["part"], r["where"], r["balance"]) for r in rows}
    load_compiled()
    planners = {
        share: GraspPlanner(
            settings=PlannerSettings.from_mapping({"hpp": {"balance_friction_share": share}})
        )
        for share in (0.67, 0.0)
    }
    objects = collect([Path("shipped"), *arguments.objects], arguments.only, None, arguments.bullet)
    n = sum("error" not in row for row in rows)
    for part_id, part in objects.parts.items():
        for where in ("free", "table"):
            for share, planner in planners.items():
                if (part_id, where, share) in done:
                    continue
                key = {"part": part_id, "where": where, "balance": share}
                made = case(planner, part, key, arguments, n)
                n += sum("error" not in row for row in made)
                with file.open("a") as stream:
                    stream.writelines(json.dumps(row) + "\n" for row in made)
                held = Counter(row["mujoco"]["held"] for row in made if "mujoco" in row)
                print(part_id, where, share, f"{held[True]} of {held.total()} held", flush=True)
                (arguments.out / "report.md").write_text(report(read(file), arguments))


def read(file):
    """The rows of a file; none where it is not there."""
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def share_text(verdicts):
    """Share with Wilson's interval."""
    share = Share.of(verdicts)
    low, high = share.interval
    return (
        f"{share.passed} of {share.n}, {100 * share.value:.1f} % ({100 * low:.0f}-{100 * high:.0f})"
    )


def separation(values, held):
    """Probability that a grasp that holds has the larger value than one that does not (AUC)."""
    values, held = np.asarray(values), np.asarray(held)
    if held.all() or not held.any():
        return float("nan")
    statistic = mannwhitneyu(values[held], values[~held]).statistic
    return float(statistic / (held.sum() * (~held).sum()))


def report(rows, arguments):
    """Markdown of all rows."""
    tried = [row for row in rows if "mujoco" in row]
    lines = [
        "# Two engines over the same grasps",
        "",
        f"    python tests/benchmarks/engine_study.py --out OUT --bullet {arguments.bullet} "
        f"--fine {arguments.fine}" + (" --objects DIR" if arguments.objects else ""),
        "",
        f"{len(tried)} grasps of {len({row['part'] for row in tried})} parts, planned for "
        f"{arguments.seconds:g} s, ranks {', '.join(str(rank + 1) for rank in RANKS)}; strict "
        "protocol, 0.1 kg, friction 0.6 or what was planned with. Shares with Wilson's 95 % "
        "intervals.",
        "",
        "| | same verdict | held in both | Bullet alone | MuJoCo alone |",
        "|---|---|---|---|---|",
    ]
    for where in ("free", "table", "all"):
        group = [row for row in tried if where in ("all", row["where"])]
        pairs = [(row["bullet"]["held"], row["mujoco"]["held"]) for row in group]
        count = Counter(pairs)
        lines.append(
            f"| {where} | {share_text([a == b for a, b in pairs])} | {count[True, True]} | "
            f"{count[True, False]} | {count[False, True]} |"
        )
    lines += ["", "## Steps of a quarter", "", "| | same verdict as by its own fine steps |"]
    lines.append("|---|---|")
    for name in ENGINES:
        fine = [row for row in tried if f"{name} fine" in row]
        same = [row[name]["held"] == row[f"{name} fine"]["held"] for row in fine]
        lines.append(f"| {name} | {share_text(same)} |")
    fine = [row for row in tried if "bullet fine" in row]
    same = [row["bullet fine"]["held"] == row["mujoco fine"]["held"] for row in fine]
    lines += [f"| both fine, one against the other | {share_text(same)} |", ""]
    lines += ["## Time of a trial [s]", "", "| | median | mean |", "|---|---|---|"]
    for name in ENGINES:
        spent = [row[name]["elapsed_s"] for row in tried]
        lines.append(f"| {name} | {np.median(spent):.2f} | {np.mean(spent):.2f} |")
    lines += ["", *balance_lines(tried), *selection_lines(tried)]
    lines += ["## Grasps over which the engines differ", ""]
    lines += ["| part | | rank | imbalance | Bullet | MuJoCo | Bullet fine | MuJoCo fine |"]
    lines += ["|---|---|---|---|---|---|---|---|"]
    for row in tried:
        if row["bullet"]["held"] != row["mujoco"]["held"]:
            said = [
                (row[name]["cause"] or "held") if name in row else "-"
                for name in (*ENGINES, *(f"{name} fine" for name in ENGINES))
            ]
            lines.append(
                f"| {row['part']} | {row['where']} | {row['rank'] + 1} | {row['imbalance']:.2f} | "
                + " | ".join(said)
                + " |"
            )
    errors = Counter((row["where"], row["error"]) for row in rows if "error" in row)
    lines += ["", f"Cases without a grasp: {sum(errors.values())}.", ""]
    return "\n".join(lines)


def balance_lines(tried):
    """How well imbalance and epsilon tell which grasps hold, and how far parts are pushed."""
    lines = ["## The closing balance", ""]
    lines += ["| imbalance | grasps | held in both | part pushed while closing, median [mm] |"]
    lines += ["|---|---|---|---|"]
    held = [row["bullet"]["held"] and row["mujoco"]["held"] for row in tried]
    for low, high in pairwise(EDGES):
        inside = [
            (row, both)
            for row, both in zip(tried, held, strict=True)
            if low <= row["imbalance"] < high
        ]
        if inside:
            pushed = np.median([row["mujoco"]["closing_slip_mm"] for row, _ in inside])
            share = share_text([both for _, both in inside])
            lines.append(f"| {low:g} to {high:g} | {len(inside)} | {share} | {pushed:.2f} |")
    lines += ["", "| tells held from not held (AUC) | free | table | all |", "|---|---|---|---|"]
    for name, sign in (("imbalance", -1.0), ("epsilon", 1.0)):
        cells = []
        for where in ("free", "table", "all"):
            rows = [
                (sign * row[name], both)
                for row, both in zip(tried, held, strict=True)
                if where in ("all", row["where"])
            ]
            cells.append(f"{separation(*zip(*rows, strict=True)):.2f}" if rows else "-")
        lines.append(f"| {name} | {' | '.join(cells)} |")
    if len(tried) > 2:
        pushed = [row["mujoco"]["closing_slip_mm"] for row in tried]
        rank = spearmanr([row["imbalance"] for row in tried], pushed).statistic
        lines += ["", f"Spearman's correlation of imbalance and push: {rank:.2f}."]
    return [*lines, ""]


def selection_lines(tried):
    """What the search answers first with the balance in its objective, and without."""
    lines = ["## First grasps, without trials", ""]
    lines += ["| objective | where | held in both | pushed under 5 mm | mean epsilon |"]
    lines += ["|---|---|---|---|---|"]
    for share, name in ((0.67, "with the balance"), (0.0, "epsilon and volume")):
        for where in ("free", "table"):
            rows = [
                row
                for row in tried
                if row["rank"] == 0 and row["where"] == where and row["balance"] == share
            ]
            if rows:
                held = share_text([r["bullet"]["held"] and r["mujoco"]["held"] for r in rows])
                still = share_text([r["mujoco"]["closing_slip_mm"] < 5.0 for r in rows])
                epsilon = np.mean([row["epsilon"] for row in rows])
                lines.append(f"| {name} | {where} | {held} | {still} | {epsilon:.4f} |")
    return [*lines, ""]


def main() -> None:
    """Run what is left of the study."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the study")
    parser.add_argument("--objects", type=Path, nargs="*", default=[], help="folders of meshes")
    parser.add_argument("--bullet", type=int, default=20, help="random parts of PyBullet")
    parser.add_argument("--only", nargs="*", default=[], help="these parts alone")
    parser.add_argument("--seconds", type=float, default=4.0, help="of planning; default 4")
    parser.add_argument("--fine", type=int, default=0, help="try each n-th also with short steps")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    run(arguments, arguments.out / "grasps.jsonl")
    rows = read(arguments.out / "grasps.jsonl")
    (arguments.out / "report.md").write_text(report(rows, arguments))
    print(f"done in {time.monotonic() - began:.0f} s")


if __name__ == "__main__":
    main()
