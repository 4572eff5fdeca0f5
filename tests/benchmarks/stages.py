"""Where the time of a plan goes: processor time of every stage, one core, and the former version's.

    python tests/benchmarks/stages.py
    python tests/benchmarks/stages.py --against ../former --repeats 5 --out docs/benchmark/stages

Every stage is timed inside a plan that ends by its number of attempts, so that two versions do the
same work; a stage inside another one counts for itself alone. `--against` names another checkout of
this repository whose kernels are compiled: both run side by side, each in a process of its own on
a core of its own, and change cores from one repeat to the next, so that whatever else the machine
does meets both. Of the repeats the least time of each stage counts.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

# Stage, module, and what is timed there; of a version that has no such thing the stage is missing.
STAGES = (
    ("read a mesh file", "geometry.catalogue", "MeshCatalogue.load"),
    ("judge the mesh", "geometry.defects", "judge"),
    ("surface (GPIS)", "plan.preparation", "fit_part"),
    ("distance field", "geometry.distance_field", "DistanceField.of"),
    ("triangle tree", "geometry.triangle_tree", "TriangleTree.of"),
    ("palms out of collision", "scene.compiled_evaluator", "CompiledEvaluator.clear_palm"),
    ("close, contacts, epsilon", "scene.compiled_evaluator", "CompiledEvaluator.attempt"),
    ("the same from a posture", "scene.compiled_evaluator", "CompiledEvaluator.attempt_from"),
    ("closing balance", "grasp.balanced_evaluator", "BalancedEvaluator.judged"),
    ("closing balance", "grasp.balanced_evaluator", "BalancedEvaluator._judged"),  # former name
    ("model: fit", "optimise.bayesian", "BayesianOptimiser.tell"),
    ("model: acquisition", "optimise.bayesian", "BayesianOptimiser.ask_batch"),
    ("settle on a chart", "search.local_adaption", "LocalAdaption.__call__"),
    ("contacts first", "search.contacts.contact_first", "ContactFirst.attempt"),
    ("list of grasps", "search.archive", "GraspArchive.add"),
    ("finish grasps", "plan.finisher", "Finisher.best"),
    ("cover by convex pieces", "verification.convex_cover", "ConvexCover.add"),
    ("trial in physics", "verification.protocol", "Verifier.verify"),
)
WHOLE = "the rest"
_N_TRIED = 5


class Account:
    """Processor time by stage, without that of the stages inside; of the main thread alone."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = {}
        self._open: list[float] = []

    def timed(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, its time counted as a stage's."""

        def call(*args: Any, **kwargs: Any) -> Any:
            if threading.current_thread() is not threading.main_thread():
                return function(*args, **kwargs)
            self._open.append(0.0)
            start = time.thread_time()
            try:
                return function(*args, **kwargs)
            finally:
                whole = time.thread_time() - start
                inside = self._open.pop()
                self.spent[stage] = self.spent.get(stage, 0.0) + whole - inside
                if self._open:
                    self._open[-1] += whole

        return call

    def watch(self, stage: str, module: str, name: str) -> None:
        """Time a function or method of the planner from now on, if there is such a thing."""
        with suppress(ImportError, AttributeError):
            holder: Any = importlib.import_module(f"gpis_grasp_planner.{module}")
            *way, last = name.split(".")
            for step in way:
                holder = getattr(holder, step)
            kept = vars(holder)[last] if last in vars(holder) else getattr(holder, last)
            static = isinstance(kept, staticmethod)
            timed = self.timed(stage, kept.__func__ if static else kept)
            setattr(holder, last, staticmethod(timed) if static else timed)


def measure(part_id: str, attempts: int) -> dict[str, float]:
    """Seconds of each stage of one plan and its trials, and the attempts that were made."""
    os.environ["GPIS_GRASP_STORE"] = "off"
    from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
    from gpis_grasp_planner.plan.planner import GraspPlanner
    from gpis_grasp_planner.plan.request import PlanRequest
    from gpis_grasp_planner.plan.warm_up import load_compiled
    from gpis_grasp_planner.verification.protocol import Verifier, prepare
    from gpis_grasp_planner.verification.settings import VerificationSettings

    load_compiled()
    account = Account()
    for stage in STAGES:
        account.watch(*stage)

    def work() -> int:
        part = MeshCatalogue([default_catalogue_directory()]).load(part_id)
        planner = GraspPlanner()
        # here and not in threads beside this one, which are not counted
        preparation = importlib.import_module("gpis_grasp_planner.plan.preparation")
        preparation.DistanceField.of(part.working_mesh)
        preparation.TriangleTree.of(part.mesh)
        preparation.fit_part(part.working_mesh, planner.settings.surface)
        request = PlanRequest(
            time_budget_s=600.0, verification="none", max_evaluations=attempts, n_grasps=_N_TRIED
        )
        result = planner.answer(part, request).result
        settings = VerificationSettings()
        with Verifier(part, planner.hand, settings, prepare(part, settings)) as verifier:
            for grasp in result.grasps[:_N_TRIED]:
                verifier.verify(grasp)
        return int(result.evaluations)

    made = account.timed(WHOLE, work)()
    return {**account.spent, "attempts": float(made)}


def run(root: Path, part_id: str, attempts: int, core: int | None) -> subprocess.Popen[str]:
    """The measurement of a checkout, begun in a process of its own."""
    sources = root / "ros2_ws" / "src" / "gpis_grasp_planner"
    path = os.pathsep.join([str(sources), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, __file__, "--one", part_id, "--attempts", str(attempts)]
    if core is not None:
        command += ["--core", str(core)]
    return subprocess.Popen(
        command,
        cwd=root,
        env={**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        text=True,
    )


def figures(process: subprocess.Popen[str]) -> dict[str, float]:
    """What a measurement printed."""
    text, _ = process.communicate()
    if process.returncode:
        sys.exit(f"A measurement ended with code {process.returncode}; its message is above.")
    return dict(json.loads(text.splitlines()[-1]))


def least(runs: list[dict[str, float]]) -> dict[str, float]:
    """The least of each figure over the repeats."""
    return {name: min(one.get(name, 0.0) for one in runs) for name in runs[0]}


def table(now: list[dict[str, float]], former: list[dict[str, float]]) -> list[str]:
    """Markdown: milliseconds in the mean of the parts, shares, and former over now."""
    names = [*dict.fromkeys(stage for stage, *_ in STAGES), WHOLE]
    total = sum(one.get(name, 0.0) for one in now for name in names)
    head = ["| stage | ms | share |", "|---|---|---|"]
    if former:
        head = [row + extra for row, extra in zip(head, [" former / now |", "---|"], strict=True)]
    rows = []
    for name in names:
        spent = sum(one.get(name, 0.0) for one in now)
        if not spent:
            continue
        row = f"| {name} | {1e3 * spent / len(now):.1f} | {100 * spent / total:.1f} % |"
        if former:
            before = sum(one.get(name, 0.0) for one in former)
            row += f" {before / spent:.2f} |" if before else " |"
        rows.append(row)
    return head + rows


def attempts_line(runs: list[dict[str, float]], whose: str) -> str:
    """Attempts a second of processor time: of the compiled attempt, and of the search."""
    kernel = ("close, contacts, epsilon", "the same from a posture")
    before = {"read a mesh file", "surface (GPIS)", "distance field", "triangle tree"}
    after = {"cover by convex pieces", "trial in physics", "attempts"}
    alone = [one["attempts"] / sum(one.get(name, 0.0) for name in kernel) for one in runs]
    whole = [
        one["attempts"] / sum(s for name, s in one.items() if name not in before | after)
        for one in runs
    ]
    return (
        f"{whose}: {statistics.mean(alone):.0f} attempts a second of processor time in the "
        f"compiled attempt alone ({min(alone):.0f} to {max(alone):.0f} by part), "
        f"{statistics.mean(whole):.0f} with the whole search "
        f"({min(whole):.0f} to {max(whole):.0f})."
    )


def main() -> None:
    """Measure and print; with --out also keep the report and the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--parts", nargs="+", default=["mug", "flange", "phone", "spur_gear"])
    parser.add_argument("--attempts", type=int, default=2000)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--against", type=Path, help="another checkout, compiled")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--one", help=argparse.SUPPRESS)
    parser.add_argument("--core", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        if arguments.core is not None:
            os.sched_setaffinity(0, {arguments.core})
        print(json.dumps(measure(arguments.one, arguments.attempts)))
        return
    here = Path(__file__).resolve().parents[2]
    cores = sorted(os.sched_getaffinity(0))[:2]
    now, former = [], []
    for part_id in arguments.parts:
        ours, theirs = [], []
        for repeat in range(arguments.repeats):
            a, b = (cores[repeat % len(cores)], cores[(repeat + 1) % len(cores)])
            running = run(here, part_id, arguments.attempts, a)
            if arguments.against:
                other = run(arguments.against.resolve(), part_id, arguments.attempts, b)
                theirs.append(figures(other))
            ours.append(figures(running))
        now.append(least(ours))
        former += [least(theirs)] if theirs else []
        print(f"{part_id}: done", file=sys.stderr)
    lines = [*table(now, former), "", attempts_line(now, "Now")]
    if former:
        lines += ["", attempts_line(former, "Former")]
    print("\n".join(lines))
    if arguments.out:
        arguments.out.mkdir(parents=True, exist_ok=True)
        (arguments.out / "tables.md").write_text("\n".join(lines) + "\n")
        rows = {"parts": arguments.parts, "now": now, "former": former}
        (arguments.out / "stages.json").write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
