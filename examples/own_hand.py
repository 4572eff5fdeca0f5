"""Plan with another hand: the name of one that is there, or the YAML file of your own.

python own_hand.py [HAND]
"""

import sys

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.hand.settings import HandSettings
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings

model = sys.argv[1] if len(sys.argv) > 1 else "parallel_jaw"
planner = GraspPlanner(PlannerSettings(hand=HandSettings(model=model)))
part = MeshCatalogue([default_catalogue_directory()]).load("stepped_shaft")
result = planner.plan(part, PlanRequest(time_budget_s=3.0))
print(result.code.name, result.message)
if result.grasps:
    best = result.grasps[0]
    for name, value in zip(planner.hand.joint_names, best.joints, strict=True):
        print(f"{name} {value:.4f}")
