"""Do first grasps hold: in both engines, slippery with the CAD mass, displaced, and over draws.

    python tests/benchmarks/hold_study.py plan --out holds --version present --objects HARD
    python tests/benchmarks/hold_study.py judge --out holds

`plan` plans on every part, free and in its most probable pose on a table, and appends the answers
to `OUT/answers.jsonl`; with another checkout's packages in PYTHONPATH it does so for that version.
`judge` tries the first grasp of each answer in trials of its own (other draws than the planner's),
appends to `OUT/verdicts.jsonl`, and writes `OUT/tables.md`. What stands there is not made again. An
answer counts as one with a first grasp where its code is SUCCESS.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import Counter, defaultdict
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from resting_poses import place_at_rest

from gpis_grasp_benchmark.shares import MeanInterval, Share
from gpis_grasp_benchmark.study_objects import collect
from gpis_grasp_planner.errors import GraspPlannerError
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.warm_up import load_compiled
from gpis_grasp_planner.verification.settings import VerificationSettings

PLACES = ("free", "table")
ENGINES = ("mujoco", "bullet")
JUDGE_SEED = 20_260_000  # no request has it
N_DISPLACED = 5
# The protocol that DRO-Grasp states: friction 3, pushes of 0.5 m/s^2 for 1 s, 2 cm.
MILD = {"friction": 3.0, "acceleration_m_s2": 0.5, "duration_s": 1.0, "slip_limit_m": 0.02}
PUSHED_M = 0.005


def main() -> None:
    """Plan or judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mode", choices=("plan", "judge"))
    parser.add_argument("--out", type=Path, required=True, help="folder of the study")
    parser.add_argument("--version", default="present", help="name of what plans")
    parser.add_argument("--objects", type=Path, nargs="*", default=[], help="folders of meshes")
    parser.add_argument("--bullet", type=int, default=0, help="random parts of PyBullet")
    parser.add_argument("--places", nargs="*", choices=PLACES, default=list(PLACES))
    parser.add_argument("--each", type=int, default=1, help="every n-th part alone")
    parser.add_argument("--seconds", type=float, default=10.0, help="budget; default 10")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    if arguments.mode == "plan":
        plan(arguments)
    else:
        judge(arguments)
        (arguments.out / "tables.md").write_text(report(arguments.out))


def parts_of(arguments):
    """All parts of the study by their name."""
    folders = arguments.objects or [Path("shipped")]
    found = collect(folders, (), None, arguments.bullet, 0)
    names = sorted(found.parts)[:: arguments.each]
    return {name: found.parts[name] for name in names}


def read(file):
    """Rows of a file of JSON lines."""
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def key(row):
    """What makes a case."""
    return row["version"], row["part"], row["place"]


def plan(arguments):
    """Append the answers that are missing."""
    file = arguments.out / "answers.jsonl"
    done = {key(row) for row in read(file)}
    load_compiled()
    planner = GraspPlanner()
    for name, part in parts_of(arguments).items():
        for where in arguments.places:
            row = {"version": arguments.version, "part": name, "place": where}
            if key(row) in done:
                continue
            row |= {"load": round(os.getloadavg()[0], 2), "seconds": arguments.seconds}
            request = PlanRequest(time_budget_s=arguments.seconds, seed=0, verification="rank")
            start = time.monotonic()
            try:
                result = planner.answer(part, request, place_at_rest(part, where)).result
                row |= {
                    "code": result.code.name,
                    "n": len(result.grasps),
                    "first": first_of(result.grasps[0]) if result.grasps else None,
                }
            except GraspPlannerError as error:
                row |= {"code": error.code.name, "n": 0, "first": None}
            row["elapsed_s"] = round(time.monotonic() - start, 2)
            with file.open("a") as out:
                out.write(json.dumps(row) + "\n")
            print({k: v for k, v in row.items() if k != "first"}, flush=True)


def first_of(grasp):
    """What is judged of a grasp, and what its planner said of it."""
    estimate = getattr(grasp, "hold_estimate", None)
    return {
        "T_object_palm": grasp.T_object_palm.tolist(),
        "joints": grasp.joints.tolist(),
        "pregrasp_joints": grasp.pregrasp_joints.tolist(),
        "epsilon": grasp.epsilon,
        "estimate": None
        if estimate is None
        else [estimate.probability, estimate.low, estimate.high, estimate.n],
    }


def judge(arguments):
    """Append the verdicts that are missing."""
    file = arguments.out / "verdicts.jsonl"
    done = {key(row) for row in read(file)}
    planner, parts = GraspPlanner(), parts_of(arguments)
    for row in read(arguments.out / "answers.jsonl"):
        if key(row) in done or row["first"] is None or row["part"] not in parts:
            continue
        verdict = {name: row[name] for name in ("version", "part", "place")}
        verdict |= tried(planner, parts[row["part"]], row["first"])
        with file.open("a") as out:
            out.write(json.dumps(verdict) + "\n")
        print(verdict, flush=True)


def tried(planner, part, first):
    """Verdicts over one grasp: by name, true or the cause why not."""
    from gpis_grasp_planner.verification.cases import cad_mass, finalist_cases
    from gpis_grasp_planner.verification.pose_noise import displacements
    from gpis_grasp_planner.verification.protocol import Verifier, prepare

    names = ("T_object_palm", "joints", "pregrasp_joints")
    grasp = SimpleNamespace(**{name: np.array(first[name]) for name in names})
    settings = VerificationSettings()
    friction = PlanRequest().friction_for(part.friction)
    nominal = replace(settings, friction=min(settings.friction, friction.finger))
    less = nominal.friction / settings.friction
    slippery = replace(
        nominal, friction=less * settings.low_friction, mass_kg=cad_mass(part, settings)
    )
    made = planner.prepare(part)
    prepared = prepare(part, settings, made.field, made.tree)
    found = {}
    for engine in ENGINES:
        base = replace(nominal, engine=engine)
        with Verifier(part, planner.hand, base, prepared) as verifier:
            for name, case in (("nominal", base), ("slippery", replace(slippery, engine=engine))):
                verifier.use(case)
                verdict = verifier.verify(grasp)
                found[f"{name} {engine}"] = verdict.held or verdict.cause
                if name == "nominal":
                    found[f"push {engine}"] = verdict.closing_slip_m
            if engine != "mujoco":
                continue
            verifier.use(base)
            moves = displacements(part, replace(base, noise_repeats=N_DISPLACED), JUDGE_SEED)
            held = [verifier.verify_displaced(grasp, move).held for move in moves]
            found["displaced"] = sum(held)
            cases = finalist_cases(part, friction, base, JUDGE_SEED)
            held = []
            for case in cases[1:-1]:
                verifier.use(case.settings)
                held.append(verifier.verify_displaced(grasp, case.displacement).held)
            found["draws"], found["n_draws"] = sum(held), len(held)
    mild = replace(settings, engine="mujoco", **MILD)
    with Verifier(part, planner.hand, mild, prepared) as verifier:
        found["mild mujoco"] = verifier.verify(grasp).held
    return found


def report(out):
    """Shares by version and place, their causes, and whether estimates are true."""
    answers = {key(row): row for row in read(out / "answers.jsonl")}
    verdicts = {key(row): row for row in read(out / "verdicts.jsonl")}
    groups = defaultdict(list)
    for case in answers:
        groups[case[0], case[2]].append(case)
    lines = [
        "Of all parts of a row; a part without an answer is in none of the shares but the first.",
        "",
        "| version, place | answered | ten or more | both engines | slippery, CAD mass | "
        "displaced, most of five | single displacements | draws | mild | push < 5 mm |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    causes = Counter()
    for (version, where), cases in sorted(groups.items()):
        good = [c for c in cases if answers[c]["code"] == "SUCCESS" and c in verdicts]
        v = [verdicts[c] for c in good]
        both = [all(row[f"nominal {e}"] is True for e in ENGINES) for row in v]
        slippery = [row["slippery mujoco"] is True for row in v]
        for row in v:
            for e in ENGINES:
                if row[f"nominal {e}"] is not True:
                    causes[version, where, f"nominal {e}", str(row[f"nominal {e}"])] += 1
            if row["slippery mujoco"] is not True:
                causes[version, where, "slippery", str(row["slippery mujoco"])] += 1
        shares = [
            [answers[c]["code"] == "SUCCESS" for c in cases],
            [answers[c]["n"] >= 10 for c in cases],
            both,
            slippery,
            [row["displaced"] > N_DISPLACED // 2 for row in v],
        ]
        cells = [share(s) for s in shares]
        cells.append(mean([row["displaced"] / N_DISPLACED for row in v]))
        cells.append(mean([row["draws"] / row["n_draws"] for row in v]))
        cells.append(share([row["mild mujoco"] for row in v]))
        cells.append(share([row["push mujoco"] < PUSHED_M for row in v]))
        lines.append(f"| {version}, {where} | " + " | ".join(cells) + " |")
    lines += ["", "Failures by cause:", ""]
    lines += [f"- {', '.join(what)}: {n}" for what, n in sorted(causes.items())]
    return "\n".join([*lines, "", *calibration(answers, verdicts)]) + "\n"


def mean(values):
    """A mean with its interval, as text."""
    if not values:
        return "-"
    of = MeanInterval.of(values)
    return f"{of.mean:.0%} ({of.low:.0%}-{of.high:.0%})"


def share(verdicts):
    """A share with its interval, as text."""
    if not verdicts:
        return "-"
    of = Share.of(verdicts)
    low, high = of.interval
    return f"{of.passed} of {of.n} ({low:.0%}-{high:.0%})"


def calibration(answers, verdicts):
    """Estimates of the planner beside the shares that held in draws that it had not seen."""
    rows = [
        (answers[c]["first"]["estimate"][0], verdicts[c]["draws"] / verdicts[c]["n_draws"])
        for c in verdicts
        if answers[c]["code"] == "SUCCESS" and answers[c]["first"]["estimate"]
    ]
    if not rows:
        return []
    told, seen = np.array(rows).T
    lines = ["Estimates beside other draws:", "", "| estimate | grasps | mean | held |"]
    lines.append("|---|---|---|---|")
    for low, high in ((0.0, 0.5), (0.5, 0.7), (0.7, 0.85), (0.85, 1.01)):
        among = (told >= low) & (told < high)
        if among.any():
            lines.append(
                f"| {low:g} to {min(high, 1.0):g} | {among.sum()} | {told[among].mean():.2f} | "
                f"{seen[among].mean():.2f} |"
            )
    return lines


if __name__ == "__main__":
    main()
