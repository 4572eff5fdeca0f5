"""Plan for a part that stands on a table: no answered grasp comes through it."""

import numpy as np

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.surroundings.obstacles import SupportPlane, Surroundings
from gpis_grasp_planner.surroundings.place import Place

TABLE_HEIGHT_M = 0.75

part = MeshCatalogue([default_catalogue_directory()]).load("mug")
T_world_object = np.eye(4)
T_world_object[:3, 3] = [0.5, 0.0, TABLE_HEIGHT_M - part.mesh.bounds[0][2]]
table = SupportPlane(np.array([0.0, 0.0, TABLE_HEIGHT_M]), np.array([0.0, 0.0, 1.0]))
place = Place(T_world_object, Surroundings(table))
answer = GraspPlanner().answer(part, PlanRequest(time_budget_s=3.0), place)
print(answer.result.code.name, answer.result.message)
for grasp, clearance in zip(answer.result.grasps[:3], answer.clearances, strict=False):
    palm = T_world_object @ grasp.T_object_palm
    print(f"palm at {np.round(palm[:3, 3], 3)} m, {1e3 * clearance.distance_m:.1f} mm to the table")
