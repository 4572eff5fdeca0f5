"""Parts resting on a table: is there an answer, is it clear, does it hold, and how good is it.

    python tests/benchmarks/table_study.py --out table --seconds 10 --poses 2 --bullet 20
    python tests/benchmarks/table_study.py --out table --former CHECKOUT --only mug flask

Every part is put down in its most probable resting poses and planned for there. An independent
collision library walks the hand's way against the plane, and the table lift tries the first grasp.
A case that stands in `OUT/cases.jsonl` is not made again, so that a study can be ended and gone on
with; `OUT/tables.md` is of all that stand there. `--former` does the same cases by a former
checkout's own way (a search in free space, then the grasps that are clear); the judges are ours.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import coal
import numpy as np

TESTS = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(TESTS))

from planning_fixtures import CoalReferee  # noqa: E402
from resting_poses import resting_poses  # noqa: E402

from gpis_grasp_benchmark.shares import MeanInterval, Share  # noqa: E402
from gpis_grasp_benchmark.study_objects import collect  # noqa: E402
from gpis_grasp_planner.errors import GraspPlannerError  # noqa: E402
from gpis_grasp_planner.plan.planner import GraspPlanner  # noqa: E402
from gpis_grasp_planner.plan.request import PlanRequest  # noqa: E402
from gpis_grasp_planner.plan.warm_up import load_compiled  # noqa: E402
from gpis_grasp_planner.surroundings.obstacles import SupportPlane, Surroundings  # noqa: E402
from gpis_grasp_planner.surroundings.place import Place  # noqa: E402
from gpis_grasp_planner.verification.protocol import Verifier, prepare  # noqa: E402
from gpis_grasp_planner.verification.settings import VerificationSettings  # noqa: E402
from gpis_grasp_planner.verification.table_lift import verify_lift  # noqa: E402

ROUNDING_M = 1e-6
STEPS = (5, 12)  # of the approach and of the closing, at which coal looks
FIELDS = ("T_object_palm", "joints", "pregrasp_joints", "approach_direction")


def answer_now(planner, case, part):
    """Code, message, grasps and best attempt of this version."""
    up = np.array(case["up"])
    place = Place(surroundings=Surroundings(SupportPlane(up * case["height"], up)))
    request = PlanRequest(
        time_budget_s=case["budget_s"], seed=case["seed"], verification=case["verification"]
    )
    try:
        result = planner.answer(part, request, place).result
    except GraspPlannerError as error:
        return error.code.name, str(error), [], None
    return result.code.name, result.message, [seen(g) for g in result.grasps], result.best_attempt


def seen(grasp):
    """What is judged of a grasp."""
    return SimpleNamespace(
        **{name: getattr(grasp, name) for name in FIELDS},
        approach_distance=grasp.approach_distance,
        epsilon=grasp.epsilon,
        held=bool(grasp.trials is not None and grasp.trials.held),
    )


def start_former(checkout, case, part, folder):
    """Begin a case with a former version, in a process of its own."""
    file = Path(folder) / f"{case['part']}-{case['pose']}.json"
    mesh = {"vertices": part.mesh.vertices.tolist(), "faces": part.mesh.faces.tolist()}
    friction = part.friction and [part.friction.finger, part.friction.palm]
    body = {"friction": friction, "center_of_mass": part.center_of_mass.tolist(), "mass": part.mass}
    file.write_text(json.dumps({**case, **mesh, **body, "volume": part.volume}))
    source = checkout / "ros2_ws" / "src" / "gpis_grasp_planner"
    environment = {**os.environ, "PYTHONPATH": str(source)}
    command = [sys.executable, str(TESTS / "former_version.py"), str(file)]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)


def answer_of_former(process):
    """Code, message and grasps from its process."""
    output, _ = process.communicate()
    if process.returncode:
        return f"exit code {process.returncode}", "", [], None
    found = json.loads(output)
    arrays = [{**g, **{name: np.array(g[name]) for name in FIELDS}} for g in found["grasps"]]
    found["message"] += f" ({found['elapsed_s']:.1f} s of planning.)"
    return found["code"], found["message"], [SimpleNamespace(**g) for g in arrays], None


def judge(planner, referee, part, case, grasps, attempt):
    """What coal and the table lift say about an answer."""
    up = np.array(case["up"])
    table = coal.Halfspace(up, float(case["height"]))
    gaps = [
        min(referee.distance(poses, table, np.eye(4)) for poses in referee.way(grasp, *STEPS))
        for grasp in grasps
    ]
    clear = [g for g, gap in zip(grasps, gaps, strict=True) if gap >= -ROUNDING_M]
    row = {
        "n": len(grasps),
        "n_clear": len(clear),
        "first_gap_mm": round(1e3 * gaps[0], 3) if gaps else None,
        "first_tried_and_held": bool(grasps and grasps[0].held),
        "best_clear_epsilon": max((g.epsilon for g in clear), default=0.0),
        "first_epsilon": grasps[0].epsilon if grasps else 0.0,
        "lift": "no grasp",
    }
    tried = grasps[0] if grasps else attempt
    if tried is not None:
        prepared, settings = planner.prepare(part), VerificationSettings()
        pieces = prepare(part, settings, prepared.field, prepared.tree)
        with Verifier(part, planner.hand, settings, pieces) as verifier:
            lift = verify_lift(verifier, tried, up)
        row["lift" if grasps else "attempt_lift"] = "held" if lift.held else lift.cause
    return row


def make_cases(arguments):
    """Parts by ID with their sets, and the cases, each on a table below the part."""
    directories = [Path("shipped"), *arguments.objects]
    objects = collect(directories, arguments.only, None, arguments.bullet, arguments.seed)
    cases = []
    for part_id, part in objects.parts.items():
        poses = resting_poses(part.mesh.vertices, part.center_of_mass)[: arguments.poses]
        for number, pose in enumerate(poses):
            cases.append(
                {
                    "version": "former" if arguments.former else "present",
                    "part": part_id,
                    "set": objects.set_of[part_id],
                    "pose": number,
                    "probability": round(pose.probability, 4),
                    "up": pose.up.tolist(),
                    "height": float((part.mesh.vertices @ pose.up).min()),
                    "budget_s": arguments.seconds,
                    "verification": arguments.verify,
                    "seed": arguments.seed,
                }
            )
    cases.sort(key=lambda case: case["pose"])
    return objects, cases[: arguments.most]


def key_of(case):
    """What tells cases apart."""
    names = ("version", "part", "pose", "budget_s", "verification", "seed")
    return tuple(case[name] for name in names)


def run(arguments, file):
    """Make the cases that are not in the file yet, and append them."""
    done = {key_of(row) for row in read(file)}
    objects, cases = make_cases(arguments)
    left = [case for case in cases if key_of(case) not in done]
    print(f"{len(cases)} cases, {len(left)} to be made", flush=True)
    if not left:
        return
    load_compiled()
    planner = GraspPlanner()
    first_part = objects.parts[left[0]["part"]]
    answer_now(planner, {**left[0], "budget_s": 1.0}, first_part)  # loads what a table needs
    referee = CoalReferee(planner.hand)
    with tempfile.TemporaryDirectory() as folder:
        at_a_time = arguments.processes if arguments.former else 1
        for first in range(0, len(left), at_a_time):
            batch = left[first : first + at_a_time]
            parts = [objects.parts[case["part"]] for case in batch]
            load, start = os.getloadavg()[0], time.monotonic()
            if arguments.former:
                started = [
                    start_former(arguments.former, case, part, folder)
                    for case, part in zip(batch, parts, strict=True)
                ]
                answers = [answer_of_former(process) for process in started]
            else:
                answers = [answer_now(planner, batch[0], parts[0])]
            spent = time.monotonic() - start
            for case, part, (code, message, grasps, attempt) in zip(
                batch, parts, answers, strict=True
            ):
                row = {**case, "code": code, "message": message}
                row |= judge(planner, referee, part, case, grasps, attempt)
                row |= {"elapsed_s": round(spent, 3), "load": round(load, 2)}
                with file.open("a") as stream:
                    stream.write(json.dumps(row) + "\n")
                print(describe(row), flush=True)


def read(file):
    """The rows of a file; none where it is not there."""
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def describe(row):
    """One line about a case."""
    return (
        f"{row['version']} {row['part']} pose {row['pose']}: {row['code']}, "
        f"{row['n_clear']} of {row['n']} clear, tried {row['first_tried_and_held']}, "
        f"lift {row['lift']}, epsilon {row['best_clear_epsilon']:.4f}, {row['elapsed_s']:.1f} s"
    )


def share_text(verdicts):
    """Share with Wilson's interval."""
    share = Share.of(verdicts)
    low, high = share.interval
    return f"{share.passed} of {share.n} ({100 * low:.0f}-{100 * high:.0f} %)"


def report(rows):
    """Markdown of all rows: shares by version and verification, failures, pairs, cases."""
    groups = {}
    for row in rows:
        groups.setdefault((row["version"], row["verification"], row["budget_s"]), []).append(row)
    lines = [
        "Shares with Wilson's 95 % intervals, means with those of the bootstrap; a case without a",
        "grasp counts as not clear, not held, and epsilon 0.",
        "",
        "| version, verification, budget | answered | first clear (coal) | first tried and held | "
        "first held in the lift | mean best clear epsilon |",
        "|---|---|---|---|---|---|",
    ]
    for (version, verification, budget), group in groups.items():
        mean = MeanInterval.of([row["best_clear_epsilon"] for row in group])
        clear = [row["n"] > 0 and row["first_gap_mm"] >= -1e3 * ROUNDING_M for row in group]
        tried = [row["first_tried_and_held"] for row in group]
        cells = [
            f"{version}, {verification}, {budget:g} s",
            share_text([row["code"] == "SUCCESS" for row in group]),
            share_text(clear),
            "-" if verification == "none" else share_text(tried),
            share_text([row["lift"] == "held" for row in group]),
            f"{mean.mean:.4f} ({mean.low:.4f}-{mean.high:.4f})",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    lines += ["", *pairs(groups), *failures(rows), "## Cases", ""]
    lines += [
        "| version | verification | part | set | pose | share | code | clear | gap of the first |"
        " tried | lift | best clear epsilon | time | load |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        gap = "-" if row["first_gap_mm"] is None else f"{row['first_gap_mm']:.1f} mm"
        lines.append(
            f"| {row['version']} | {row['verification']} | {row['part']} | {row['set']} | "
            f"{row['pose'] + 1} | {row['probability']:.2f} | {row['code']} | "
            f"{row['n_clear']}/{row['n']} | {gap} | "
            f"{'held' if row['first_tried_and_held'] else '-'} | {row['lift']} | "
            f"{row['best_clear_epsilon']:.4f} | {row['elapsed_s']:.1f} s | {row['load']:.1f} |"
        )
    return "\n".join(lines) + "\n"


def pairs(groups):
    """Epsilon of the former version and of the present one on the same cases."""
    lines = []
    for (version, verification, budget), group in groups.items():
        now = groups.get(("present", verification, budget))
        if version != "former" or now is None:
            continue
        place = {(r["part"], r["pose"], r["seed"]): r["best_clear_epsilon"] for r in now}
        gains = [
            place[k] - r["best_clear_epsilon"]
            for r in group
            if (k := (r["part"], r["pose"], r["seed"])) in place
        ]
        mean = MeanInterval.of(gains)
        lines += [
            f"Verification {verification}, {budget:g} s, present minus former on {len(gains)} "
            f"common cases: epsilon {mean.mean:+.4f} ({mean.low:+.4f} to {mean.high:+.4f}), better "
            f"in {sum(g > 0 for g in gains)}, worse in {sum(g < 0 for g in gains)}.",
            "",
        ]
    return lines


def failures(rows):
    """What falls short, by name and cause."""
    lines = ["## What falls short", ""]
    for row in rows:
        what = []
        if row["code"] != "SUCCESS":
            lift = row.get("attempt_lift")
            attempt = f" The best attempt in the table lift: {lift}." if lift else ""
            what.append(f"{row['code']}: {row.get('message', '')}{attempt}")
        if row["n_clear"] < row["n"]:
            what.append(f"{row['n'] - row['n_clear']} of {row['n']} grasps through the table")
        if row["n"] and row["verification"] != "none" and not row["first_tried_and_held"]:
            what.append("the first grasp was not seen to hold")
        if row["n"] and row["lift"] != "held":
            what.append(f"table lift: {row['lift']}")
        if what:
            name = f"{row['version']} ({row['verification']}) {row['part']}, pose {row['pose'] + 1}"
            lines.append(f"- {name}: {'; '.join(what)}")
    causes = Counter(row["lift"] for row in rows)
    return [*lines, "", f"Table lifts: {dict(causes)}.", ""]


def main() -> None:
    """Run what is left of the study and write its tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the study")
    parser.add_argument("--objects", type=Path, nargs="*", default=[], help="folders of meshes")
    parser.add_argument("--bullet", type=int, help="random parts of PyBullet, and its household")
    parser.add_argument("--only", nargs="*", default=[], help="these parts alone")
    parser.add_argument("--poses", type=int, default=1, help="resting poses per part; default 1")
    parser.add_argument("--most", type=int, help="the first cases alone")
    parser.add_argument("--seconds", type=float, default=10.0, help="budget; default 10")
    parser.add_argument("--verify", choices=("none", "rank", "require"), default="rank")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--former", type=Path, help="checkout of a former version to run instead")
    parser.add_argument("--processes", type=int, default=1, help="former cases at a time")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    file = arguments.out / "cases.jsonl"
    run(arguments, file)
    (arguments.out / "tables.md").write_text(report(read(file)))


if __name__ == "__main__":
    main()
