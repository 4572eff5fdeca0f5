"""Time to verify 20 finalists by the strict protocol, on one and on two processes.

    python tests/benchmarks/verification_cost.py --parts mug coupling_hub

Prints the wall time of the whole call, that of the convex cover (once per mesh), and the
computing time per grasp and per direction.
"""

from __future__ import annotations

import argparse
import time

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.planner import GraspPlanner
from gpis_grasp_planner.planning.request import PlanRequest
from gpis_grasp_planner.planning.verification_settings import VerificationSettings
from gpis_grasp_planner.verification.protocol import prepare, verify


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--parts", nargs="+", default=["mug", "coupling_hub"])
    parser.add_argument("--processes", type=int, nargs="+", default=[2])
    arguments = parser.parse_args()
    catalogue = MeshCatalogue([default_catalogue_directory()])
    planner = GraspPlanner()
    settings = VerificationSettings()
    for mesh_id in arguments.parts:
        part = catalogue.load(mesh_id)
        planner.prepare(part)
        request = PlanRequest(time_budget_s=5.0, friction=Friction(0.6, 0.6))
        grasps = planner.plan(part, request).grasps
        start = time.perf_counter()
        pieces = len(prepare(part, settings).pieces)
        cover_s = time.perf_counter() - start
        for processes in arguments.processes:
            start = time.perf_counter()
            found = verify(part, planner.hand, grasps, settings, processes)
            wall_s = time.perf_counter() - start
            directions = sum(len(v.directions) for v in found)
            spent = sum(v.elapsed_s for v in found)
            print(
                f"{mesh_id}: {len(grasps)} grasps, {sum(v.held for v in found)} hold, "
                f"{processes} processes: {wall_s:.1f} s; cover {cover_s:.1f} s ({pieces} pieces); "
                f"{spent / len(found):.2f} s a grasp, "
                f"{spent / max(directions, 1):.3f} s a direction"
            )


if __name__ == "__main__":
    main()
