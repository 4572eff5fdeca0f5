"""Two constraints of a request: where the hand may come from, and what it must not touch."""

import numpy as np

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.surroundings.approach_cone import ApproachCone
from gpis_grasp_planner.surroundings.forbidden_region import ForbiddenRegion

part = MeshCatalogue([default_catalogue_directory()]).load("flask")
low, high = part.mesh.bounds
T_object_box = np.eye(4)
T_object_box[2, 3] = high[2] - 0.01  # the rim, two centimetres of it
rim = ForbiddenRegion(T_object_box, np.array([0.3, 0.3, 0.02]), "rim")
from_the_side = ApproachCone(np.array([1.0, 0.0, 0.0]), 60.0, "object")
request = PlanRequest(time_budget_s=4.0, approach=from_the_side, forbidden=(rim,))
result = GraspPlanner().plan(part, request)
print(result.code.name, result.message)
highest = max(grasp.contacts.positions[:, 2].max() for grasp in result.grasps)
print(f"highest contact {1e3 * (high[2] - highest):.1f} mm below the top")
steepest = max(np.degrees(np.arccos(grasp.T_object_palm[0, 2])) for grasp in result.grasps)
print(f"largest angle to the wanted direction {steepest:.1f} degrees")
