"""What a part costs a cluster: bytes to the worker, back, in the store, and time to read it.

python tests/benchmarks/part_sizes.py --seconds 5
"""

from __future__ import annotations

import argparse
import pickle
import statistics
import time
from pathlib import Path

from gpis_grasp_planner.batch.cluster import bare_part
from gpis_grasp_planner.batch.part_planning import PartPlanning
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.plan.warm_up import load_compiled


def main() -> None:
    """Plan the parts and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=5.0, help="budget a part; default 5")
    parser.add_argument("--meshes", type=Path, default=default_catalogue_directory())
    parser.add_argument("--most", type=int, help="the first parts alone")
    arguments = parser.parse_args()
    load_compiled()
    settings, request = PlannerSettings(), PlanRequest(time_budget_s=arguments.seconds)
    planning, planner = PartPlanning(settings, request, on_lowest=True), GraspPlanner(settings)
    catalogue = MeshCatalogue([arguments.meshes])
    print("| part | grasps | sent kB | back kB | store kB | read ms |\n|---|---|---|---|---|---|")
    rows = []
    for mesh_id in catalogue.ids()[: arguments.most]:
        start = time.process_time()
        part = catalogue.load(mesh_id)
        read = 1e3 * (time.process_time() - start)
        record = planning.plan(planner, part)
        sent, back = (len(pickle.dumps(value, 5)) for value in (bare_part(part), record))
        rows.append((sent / 1e3, back / 1e3, len(record.packed()) / 1e3, read))
        cells = " | ".join(f"{value:.0f}" for value in rows[-1])
        print(f"| {mesh_id} | {len(record.result.grasps)} | {cells} |", flush=True)
    means = " | ".join(f"{statistics.fmean(column):.0f}" for column in zip(*rows, strict=True))
    print(f"| mean | | {means} |")


if __name__ == "__main__":
    main()
