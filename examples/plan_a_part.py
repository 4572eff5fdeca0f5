"""Plan grasps for a part without ROS, and keep them as a document that others can recompute."""

from pathlib import Path

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.plan.document import write_document
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest

# A file of your own: geometry.catalogue.load_part(Path("part.stl"), "mm").
part = MeshCatalogue([default_catalogue_directory()]).load("mug")
result = GraspPlanner().plan(part, PlanRequest(time_budget_s=3.0, verification="rank"))
print(result.code.name, result.message)
for grasp in result.grasps[:3]:
    held = grasp.trials is not None and grasp.trials.held
    print(f"epsilon {grasp.epsilon:.3f}, {len(grasp.contacts)} contacts, held in physics: {held}")
write_document(Path("grasps.json"), result)
