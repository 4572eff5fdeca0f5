"""Time to verify 20 finalists by the strict protocol, on one or more processes.

    python tests/benchmarks/verification_cost.py --parts mug coupling_hub --processes 1 2

Plans grasps without trials for 5 s, then tries them. Prints the wall and the computing time of the
whole call, the time of the convex cover (once per mesh), and the time per grasp and direction.
"""

from __future__ import annotations

import argparse
import os
import time

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.verification.protocol import prepare, verify
from gpis_grasp_planner.verification.settings import VerificationSettings


def computing_s() -> float:
    """Seconds that this process and the children it has waited for computed so far."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--parts", nargs="*", help="mesh IDs; all shipped ones if none")
    parser.add_argument("--processes", type=int, nargs="+", default=[2])
    arguments = parser.parse_args()
    catalogue = MeshCatalogue([default_catalogue_directory()])
    planner = GraspPlanner()
    settings = VerificationSettings()
    for mesh_id in arguments.parts or catalogue.ids():
        part = catalogue.load(mesh_id)
        planner.prepare(part)
        request = PlanRequest(time_budget_s=5.0, friction=Friction(0.6, 0.6))
        grasps = planner.plan(part, request).grasps
        start = time.perf_counter()
        pieces = len(prepare(part, settings).cover.pieces)
        cover_s = time.perf_counter() - start
        for processes in arguments.processes:
            start, before_s = time.perf_counter(), computing_s()
            found = verify(part, planner.hand, grasps, settings, processes)
            wall_s = time.perf_counter() - start
            cpu_s = computing_s() - before_s
            directions = sum(len(v.directions) for v in found)
            spent = sum(v.elapsed_s for v in found)
            print(
                f"{mesh_id}: {len(grasps)} grasps, {sum(v.held for v in found)} hold, "
                f"{processes} processes: {wall_s:.1f} s, computing {cpu_s:.1f} s; "
                f"cover {cover_s:.1f} s ({pieces} pieces); {spent / len(found):.2f} s a grasp, "
                f"{spent / max(directions, 1):.3f} s a direction"
            )


if __name__ == "__main__":
    main()
