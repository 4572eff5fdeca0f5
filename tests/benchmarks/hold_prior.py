"""What grasps of other parts say about a grasp's probability to hold: the prior of the hold model.

    python tests/benchmarks/hold_prior.py --out hold_prior --objects DIR --bullet 16
    python tests/benchmarks/hold_prior.py --out hold_prior --fit

Plans for each part, free and in its most probable pose on a table, and tries up to six grasps
(the first three and three of the others) in all cases of an answer. The weights are the most
probable ones over all parts; how far those of one part may be from them, and how many trials the
prior counts as, are chosen by the likelihood of each part's trials given the others. What stands in
`OUT/grasps.jsonl` is not made again.
"""

from __future__ import annotations

import argparse
import json
import sys
from itertools import product
from pathlib import Path

import numpy as np
from scipy.special import betaln
from scipy.stats import spearmanr

TESTS = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(TESTS))

from resting_poses import place_at_rest  # noqa: E402

from gpis_grasp_benchmark.study_objects import collect  # noqa: E402
from gpis_grasp_planner.errors import GraspPlannerError  # noqa: E402
from gpis_grasp_planner.plan.case_balance import CaseBalance  # noqa: E402
from gpis_grasp_planner.plan.planner import GraspPlanner  # noqa: E402
from gpis_grasp_planner.plan.request import PlanRequest  # noqa: E402
from gpis_grasp_planner.plan.warm_up import load_compiled  # noqa: E402
from gpis_grasp_planner.verification.cases import finalist_cases  # noqa: E402
from gpis_grasp_planner.verification.hold_model import features_of  # noqa: E402
from gpis_grasp_planner.verification.logistic import Logistic  # noqa: E402
from gpis_grasp_planner.verification.protocol import Verifier, prepare  # noqa: E402
from gpis_grasp_planner.verification.settings import VerificationSettings  # noqa: E402

_FIRST_OF_LIST, _OTHERS = 3, 3
_WIDE = 10.0
_DEVIATIONS = (0.1, 0.3, 1.0, 3.0)
_STRENGTHS = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)


def main() -> None:
    """Collect what is missing, then fit."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the study")
    parser.add_argument("--objects", type=Path, nargs="*", default=[], help="folders of meshes")
    parser.add_argument("--bullet", type=int, help="random parts of PyBullet, and its household")
    parser.add_argument("--seconds", type=float, default=4.0, help="budget of a plan; default 4")
    parser.add_argument("--fit", action="store_true", help="fit what stands there, collect nothing")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    file = arguments.out / "grasps.jsonl"
    if not arguments.fit:
        collect_all(arguments, file)
    rows = [json.loads(line) for line in file.read_text().splitlines()]
    report = fit(rows) + "\n" + of_the_corner(rows)
    (arguments.out / "tables.md").write_text(report)
    print(report)


def collect_all(arguments: argparse.Namespace, file: Path) -> None:
    """Add the grasps of all parts and places that are not in the file."""
    known = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    done = {(row["part"], row["place"]) for row in known}
    load_compiled()
    planner = GraspPlanner()
    objects = collect([Path("shipped"), *arguments.objects], (), None, arguments.bullet, 0)
    for name, part in objects.parts.items():
        for where in ("table", "free"):
            if (name, where) in done:
                continue
            rows = tried(planner, name, part, place_at_rest(part, where), where, arguments.seconds)
            with file.open("a") as out:
                out.writelines(json.dumps(row) + "\n" for row in rows)
            print(name, where, ["".join("-+"[o] for o in row["passed"]) for row in rows])


def tried(planner, name, part, place, where, seconds):
    """Some grasps of one part at one place, each with its features and verdicts."""
    request = PlanRequest(time_budget_s=seconds, seed=0, verification="none")
    try:
        grasps = list(planner.answer(part, request, place).result.grasps)
    except GraspPlannerError as error:
        print(name, where, error)
        return []
    rest = np.arange(_FIRST_OF_LIST, len(grasps))
    others = np.random.default_rng(0).permutation(rest)[:_OTHERS]
    chosen = grasps[:_FIRST_OF_LIST] + [grasps[i] for i in others]
    settings = VerificationSettings()
    cases = finalist_cases(part, request.friction_for(part.friction), settings, 0)
    made = planner.prepare(part)
    prepared = prepare(part, settings, made.field, made.tree)
    in_cases = CaseBalance(part, planner.hand, planner.settings, made, cases)
    verifiers, rows = {}, []
    for grasp in chosen:
        passed = []
        for case in cases:
            engine = case.settings.engine
            if engine not in verifiers:
                verifiers[engine] = Verifier(part, planner.hand, case.settings, prepared)
                verifiers[engine].__enter__()
            verifier = verifiers[engine]
            verifier.use(case.settings)
            move = case.displacement
            verdict = (
                verifier.verify(grasp) if move is None else verifier.verify_displaced(grasp, move)
            )
            passed.append(verdict.held)
            if not passed[0]:
                break
        rows.append(
            {
                "part": name,
                "place": where,
                "features": features_of(in_cases.judged(grasp)).tolist(),
                "passed": passed,
            }
        )
    for verifier in verifiers.values():
        verifier.__exit__(None, None, None)
    return rows


def fit(rows: list[dict]) -> str:
    """Weights, deviation and strength from rows of all parts, as a table."""
    parts = np.array([row["part"] for row in rows])
    x = np.array([row["features"] for row in rows])
    first = np.array([row["passed"][0] for row in rows], dtype=float)
    n = np.array([len(row["passed"]) - 1.0 for row in rows])
    passed = np.array([sum(row["passed"][1:]) for row in rows], dtype=float)
    wide = Logistic(np.zeros(x.shape[1]), np.eye(x.shape[1]) / _WIDE**2)
    ones = np.ones(len(rows))
    # A grasp's further trials are not independent: a dozen counts as the strength's worth only,
    # which the likelihood below decides.
    lines = [f"{len(rows)} grasps of {len(set(parts))} parts, {first.mean():.0%} passed the first"]
    lines[0] += f" case; of those {passed.sum() / n.sum():.0%} of the further cases passed."
    lines += ["", "| deviation | strength | log likelihood a further trial |", "|---|---|---|"]
    best = None
    for deviation, strength in product(_DEVIATIONS, _STRENGTHS):
        total = 0.0
        for part in dict.fromkeys(parts):
            out = parts == part
            mean = wide.updated(x[~out], passed[~out] / 12, n[~out] / 12).mean
            prior = Logistic(mean, np.eye(len(mean)) / deviation**2)
            for i in np.flatnonzero(out):  # each grasp, given the part's others
                rest = out.copy()
                rest[i] = False
                p = prior.updated(x[rest], passed[rest] / 12, n[rest] / 12).probability(x[i])
                a, b = strength * p, strength * (1.0 - p)
                total += betaln(a + passed[i], b + n[i] - passed[i]) - betaln(a, b)
        score = total / n.sum()
        lines.append(f"| {deviation:g} | {strength:g} | {score:.4f} |")
        if best is None or score > best[0]:
            best = score, deviation, strength
    assert best is not None
    lines += ["", f"Best: deviation {best[1]:g}, strength {best[2]:g}.", ""]
    lines += told_by(parts, x, first, passed, n, wide)
    for name, counted, of in (("first", first, ones), ("further", passed / 12, n / 12)):
        found = wide.updated(x, counted, of)
        error = np.sqrt(np.diag(np.linalg.inv(found.precision)))
        entries = [f"{w:.2f} ± {e:.2f}" for w, e in zip(found.mean, error, strict=True)]
        lines.append(f"Weights of the {name} case{'s' * (name != 'first')}: {', '.join(entries)}")
    return "\n".join(lines) + "\n"


def of_the_corner(rows: list[dict]) -> str:
    """On how many parts any of the tried grasps passes the last case, by place."""
    lines = ""
    for place in ("free", "table"):
        passes: dict[str, bool] = {}
        for row in (row for row in rows if row["place"] == place):
            found = row["passed"][0] and row["passed"][-1]
            passes[row["part"]] = passes.get(row["part"], False) or found
        n = sum(passes.values())
        lines += f"{place}: a tried grasp passes the corner on {n} of {len(passes)} parts.\n"
    return lines


def told_by(parts, x, first, passed, n, wide) -> list[str]:
    """What models of the other parts tell of a part's grasps, without the case balance and with."""
    lines = ["| figures | first case: AUC | further cases: rank correlation |", "|---|---|---|"]
    held = first > 0.0
    for name, columns in (("balance, epsilon, volume", 4), ("and case balance", 5)):
        told = np.zeros((2, len(parts)))
        some = x[:, :columns]
        start = Logistic(wide.mean[:columns], wide.precision[:columns, :columns])
        for part in dict.fromkeys(parts):
            own, of_first, of_held = parts == part, parts != part, (parts != part) & held
            counted = first[of_first], np.ones(of_first.sum())
            told[0, own] = start.updated(some[of_first], *counted).probability(some[own])
            counted = passed[of_held] / 12, n[of_held] / 12
            told[1, own] = start.updated(some[of_held], *counted).probability(some[own])
        pairs = told[0][held][:, None] - told[0][~held][None]
        auc = 0.5 + 0.5 * np.sign(pairs).mean()
        rank = spearmanr(told[1][held], (passed / np.maximum(n, 1.0))[held]).statistic
        lines.append(f"| {name} | {auc:.2f} | {rank:.2f} |")
    return [*lines, ""]


if __name__ == "__main__":
    main()
