"""Plan every part of a directory in one process; `gpis-grasp plan-all` does it in several.

python batch.py [DIRECTORY] [SECONDS A PART]
"""

import sys
from pathlib import Path

from gpis_grasp_planner.errors import GraspPlannerError
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest

directory = Path(sys.argv[1]) if len(sys.argv) > 1 else default_catalogue_directory()
seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 1.0
catalogue, planner = MeshCatalogue([directory]), GraspPlanner()
for mesh_id in catalogue.ids():
    try:
        result = planner.plan(catalogue.load(mesh_id), PlanRequest(time_budget_s=seconds))
    except GraspPlannerError as error:  # a file that cannot be used says why
        print(f"{mesh_id:16s} {error.code.name}: {error.message}")
        continue
    best = max((grasp.epsilon for grasp in result.grasps), default=0.0)
    print(f"{mesh_id:16s} {result.code.name}: {len(result.grasps)} grasps, epsilon {best:.3f}")
