"""Compare planners at an equal number of attempts; `gpis-grasp-benchmark` does it with intervals.

python compare_planners.py [ATTEMPTS]
"""

import sys

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.search.searches import planner_names

attempts = int(sys.argv[1]) if len(sys.argv) > 1 else 500
planner = GraspPlanner()
part = MeshCatalogue([default_catalogue_directory()]).load("coupling_hub")
for name in planner_names():
    request = PlanRequest(
        planner=name, max_evaluations=attempts, time_budget_s=120.0, n_grasps=10, seed=0
    )
    result = planner.plan(part, request)
    mean = sum(grasp.epsilon for grasp in result.grasps) / request.n_grasps
    print(f"{name:18s} mean epsilon of ten, missing ones 0: {mean:.4f}")
