"""Convergence and cost of the verification, and the share of planned grasps that hold.

Plans grasps of the shipped parts, tries them by the strict protocol at the default time step and
at finer ones, and says on how many directions the verdicts differ, what a trial costs and why
grasps fail::

    python tests/benchmarks/verification_study.py --ranks 0 1 3 6 --seconds 8 --rates 960 1920

About 1 s per grasp, friction and 1000 steps a second, with one core for itself.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.verification.protocol import prepare, verify
from gpis_grasp_planner.verification.result import Verification
from gpis_grasp_planner.verification.settings import VerificationSettings


def plan(planner: GraspPlanner, part: Part, seconds: float, ranks: list[int]) -> tuple[Grasp, ...]:
    """Grasps of a part at friction 0.6 by their ranks; the surface's fit does not count."""
    planner.prepare(part)
    request = PlanRequest(seed=0, time_budget_s=seconds, friction=Friction(0.6, 0.6))
    found = planner.plan(part, request).grasps
    return tuple(found[rank] for rank in ranks if rank < len(found))


def row(
    mesh_id: str, index: int, grasp: Grasp, settings: VerificationSettings, found: Verification
) -> dict[str, object]:
    """One trial, ready for JSON."""
    return {
        "part": mesh_id,
        "rank": index,
        "epsilon": grasp.epsilon,
        "volume": grasp.volume,
        "contacts": len(grasp.contacts),
        "links": len(set(grasp.contacts.links.tolist())),
        "rate_hz": settings.rate_hz,
        "friction": settings.friction,
    } | found.as_dict()


def differing(coarse: dict[str, object], fine: dict[str, object]) -> int:
    """Directions of a grasp whose verdicts differ; all six where only one run came to them."""

    def held(trial: dict[str, object]) -> list[bool]:
        directions = trial["directions"]
        assert isinstance(directions, tuple)
        return [d["held"] for d in directions] or [False] * 6

    return sum(a != b for a, b in zip(held(coarse), held(fine), strict=True))


def main() -> None:
    """Run the study and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ranks", type=int, nargs="+", default=[0, 1, 3, 6], help="0: the best")
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--rates", type=float, nargs="+", default=[960.0, 1920.0])
    parser.add_argument("--frictions", type=float, nargs="+", default=[0.6, 0.3])
    parser.add_argument("--parts", nargs="*", help="mesh IDs; all shipped ones if none")
    parser.add_argument("--json", type=Path, help="file for all trials")
    arguments = parser.parse_args()
    catalogue = MeshCatalogue([default_catalogue_directory()])
    planner = GraspPlanner()
    trials: dict[tuple[object, ...], dict[str, object]] = {}
    for mesh_id in arguments.parts or catalogue.ids():
        part = catalogue.load(mesh_id)
        grasps = plan(planner, part, arguments.seconds, arguments.ranks)
        prepare(part, VerificationSettings())
        for friction in arguments.frictions:
            for rate in arguments.rates:
                settings = replace(VerificationSettings(), friction=friction, rate_hz=rate)
                start = time.process_time()
                found = verify(part, planner.hand, grasps, settings, stop_at_failure=False)
                spent = time.process_time() - start
                for i, (grasp, verdict) in enumerate(zip(grasps, found, strict=True)):
                    trials[mesh_id, i, friction, rate] = row(mesh_id, i, grasp, settings, verdict)
                causes = ", ".join(v.cause or "held" for v in found)
                print(f"{mesh_id:16s} mu {friction} {rate:5.0f} Hz {spent:5.1f} s: {causes}")
        if arguments.json:
            arguments.json.write_text(json.dumps(list(trials.values())))
    report(trials, arguments.rates, arguments.frictions)


def report(
    trials: dict[tuple[object, ...], dict[str, object]],
    rates: list[float],
    frictions: list[float],
) -> None:
    """Print agreement with the finest rate, cost, shares and causes."""
    for friction in frictions:
        for rate in rates:
            mine = {k: t for k, t in trials.items() if k[2:] == (friction, rate)}
            fine = [trials[*key[:3], rates[-1]] for key in mine]
            changed = sum(differing(t, f) for t, f in zip(mine.values(), fine, strict=True))
            grasps = sum(t["held"] != f["held"] for t, f in zip(mine.values(), fine, strict=True))
            seconds = sum(float(str(t["elapsed_s"])) for t in mine.values())
            first = [t for k, t in mine.items() if k[1] == 0]
            print(
                f"mu {friction}, {rate:.0f} Hz: verdicts differ from {rates[-1]:.0f} Hz in "
                f"{changed} of {6 * len(mine)} directions, {grasps} of {len(mine)} grasps; "
                f"{seconds / max(len(mine), 1):.2f} s a grasp; first grasps held "
                f"{sum(bool(t['held']) for t in first)} of {len(first)}, all "
                f"{sum(bool(t['held']) for t in mine.values())} of {len(mine)}; "
                f"{dict(Counter(str(t['cause']) or 'held' for t in mine.values()))}"
            )


if __name__ == "__main__":
    main()
