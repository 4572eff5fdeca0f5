"""A part at random places before an arm: whether answers are reached and refusals right.

    python tests/benchmarks/arm_study.py --out docs/benchmark/arm
    python tests/benchmarks/arm_study.py --arm seven_axis --places 20 --refusals 50

puts a part on the table at random places about the arm (all round, turned at random), plans at
each and looks at every answer and at a sample of the refusals with inverse kinematics that shares
nothing with the planner: Newton's method (damped least squares) from many random postures on the
published Denavit-Hartenberg table. An answer is reached where it finds a posture within 1 mm,
0.5 degrees and the limits, and PyBullet must see its way free; a refusal is wrong where one of its
postures goes straight from the pre-grasp to the grasp and up, by small steps of the same method,
and PyBullet sees the arm free there. 100 places and 200 refusals take some 6 minutes.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from arm_referee import BulletArm, Newton

from gpis_grasp_planner.arm.constraint import ArmConstraint
from gpis_grasp_planner.arm.description import load_arm
from gpis_grasp_planner.arm.settings import ArmSettings
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.plan.warm_up import load_compiled
from gpis_grasp_planner.surroundings.obstacles import SupportPlane, Surroundings
from gpis_grasp_planner.surroundings.place import Place

TABLE = SupportPlane(np.zeros(3), np.array([0.0, 0.0, 1.0]), "table")
MASK = "arm before the closing"


class Recorder:
    """Keeps what the arm's constraint was asked and said, a random sample of each place."""

    def __init__(self, rng):
        self.rng, self.refused = rng, []
        allows, motion = ArmConstraint.allows_palm, ArmConstraint.motion
        recorder = self

        def allows_palm(constraint, T, joints, /):
            free = allows(constraint, T, joints)
            recorder.refused += [
                (MASK, constraint, np.array(palm), (start, start))
                for palm, start in zip(T[~free], np.asarray(joints)[~free], strict=True)
            ]
            return free

        def asked(constraint, T, postures):
            cause, way = motion(constraint, T, postures)
            if cause is not None:
                recorder.refused.append((str(cause), constraint, np.array(T), postures))
            return cause, way

        ArmConstraint.allows_palm, ArmConstraint.motion = allows_palm, asked

    def take(self, n):
        """Up to n refusals of the place, as evenly over the causes as there are."""
        kinds = {}
        for entry in self.refused:
            kinds.setdefault(entry[0], []).append(entry)
        self.refused = []
        chosen = []
        for kind in sorted(kinds):
            self.rng.shuffle(kinds[kind])
        while len(chosen) < n and any(kinds.values()):
            chosen += [kinds[kind].pop() for kind in sorted(kinds) if kinds[kind]]
        return chosen[:n]


def main() -> None:
    """Plan at all places, look at answers and refusals, say what was seen."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arm", default="six_axis", choices=("six_axis", "seven_axis"))
    parser.add_argument("--part", default="mug")
    parser.add_argument("--places", type=int, default=100)
    parser.add_argument("--refusals", type=int, default=200)
    parser.add_argument("--time", type=float, default=2.0, help="budget of a plan [s]; default 2")
    parser.add_argument("--far", type=float, default=1.1, help="farthest place [m]; default 1.1")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="folder of the study")
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    part = MeshCatalogue([default_catalogue_directory()]).load(arguments.part)
    load_compiled()
    settings = PlannerSettings(arm=ArmSettings(model=arguments.arm))
    planner = GraspPlanner(settings)
    planner.prepare(part)
    arm = load_arm(arguments.arm)
    newton = Newton(arguments.arm, arm, arguments.seed)
    recorder = Recorder(rng)
    rows, sample = [], []
    bullet = BulletArm(arm, planner.hand, part, settings.arm.margin_m)
    for number in range(arguments.places):
        place, radius = random_place(part, rng, arguments.far)
        request = PlanRequest(seed=number, time_budget_s=arguments.time, n_grasps=3)
        began = time.perf_counter()
        result = planner.answer(part, request, place).result
        took = time.perf_counter() - began
        sample += recorder.take(max(4, 3 * arguments.refusals // arguments.places))
        looks = [newton.look(grasp, place.T_world_object) for grasp in result.grasps]
        row = {
            "place": number,
            "radius_m": round(radius, 3),
            "code": result.code.name,
            "grasps": len(looks),
            "reached": sum(look["reached"] for look in looks),
            "free": sum(not bullet.meets(grasp, place.T_world_object) for grasp in result.grasps),
            "answer_off_mm": max((look["off_mm"] for look in looks), default=0.0),
            "attempts": result.evaluations,
            "elapsed_s": round(took, 2),
            "arm_lost": dict(result.funnel.blocked) | dict(result.funnel.screened),
        }
        rows.append(row)
        print(json.dumps(row), flush=True)
    rng.shuffle(sample)
    verdicts = []
    for cause, constraint, palm, postures in balanced(sample, arguments.refusals):
        T = constraint._T_base_object @ palm
        verdict = newton.refusal(
            T, settings, TABLE.normal, bullet, constraint._T_base_object, postures
        )
        verdicts.append((cause, verdict))
        if verdict == "free":
            print("WRONG", cause, palm.tolist(), constraint._T_base_object.tolist(), flush=True)
    bullet.close()
    text = table(rows, verdicts, arguments)
    print(text)
    if arguments.out is not None:
        arguments.out.mkdir(parents=True, exist_ok=True)
        lines = "".join(json.dumps(row) + "\n" for row in rows)
        (arguments.out / f"{arguments.arm}_rows.jsonl").write_text(lines)
        (arguments.out / f"{arguments.arm}.md").write_text(text)


def random_place(part, rng, far):
    """The part as its file has it, on the table, 0.15 m to `far` from the base."""
    radius, turn, yaw = rng.uniform(0.15, far), *rng.uniform(-np.pi, np.pi, 2)
    T = np.eye(4)
    T[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    T[:3, 3] = radius * np.cos(turn), radius * np.sin(turn), -part.mesh.bounds[0][2]
    return Place(T, Surroundings(TABLE)), radius


def balanced(sample, n):
    """Up to n of a sample, as evenly over the causes as there are."""
    kinds = {}
    for entry in sample:
        kinds.setdefault(entry[0], []).append(entry)
    chosen = []
    while len(chosen) < n and any(kinds.values()):
        chosen += [kinds[kind].pop() for kind in sorted(kinds) if kinds[kind]]
    return chosen[:n]


def table(rows, verdicts, arguments) -> str:
    """The study in Markdown."""
    grasps = sum(row["grasps"] for row in rows)
    answered = [row for row in rows if row["grasps"]]
    lines = [
        f"{arguments.part} at {len(rows)} random places up to {arguments.far:g} m from the base of "
        f"{arguments.arm}, {arguments.time:g} s each, seed {arguments.seed}.",
        "",
        "| | |",
        "|---|---|",
        f"| places answered | {len(answered)} |",
        f"| farthest answered [m] | {max((r['radius_m'] for r in answered), default=0):g} |",
        f"| grasps answered | {grasps} |",
        f"| of these reached by the independent inverse kinematics | "
        f"{sum(row['reached'] for row in rows)} |",
        f"| and whose way PyBullet sees free | {sum(row['free'] for row in rows)} |",
        f"| answered joints' largest distance from the answered palm [mm] | "
        f"{max(row['answer_off_mm'] for row in rows):.2g} |",
        f"| attempts a place, median | {np.median([row['attempts'] for row in rows]):g} |",
        f"| latest answer [s] | {max(row['elapsed_s'] for row in rows):g} |",
        "",
        "| refused because of | looked at | wrongly | why the referee refuses too |",
        "|---|---|---|---|",
    ]
    for cause in sorted({cause for cause, _ in verdicts}):
        found = Counter(verdict for other, verdict in verdicts if other == cause)
        wrong = found.pop("free", 0)
        why = ", ".join(f"{verdict} {n}" for verdict, n in found.most_common())
        lines.append(f"| {cause} | {wrong + found.total()} | {wrong} | {why} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
