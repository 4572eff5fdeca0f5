"""Rank the grasps of an answer by a measure of your own.

As an objective of the search itself a measure is registered by an entry point: docs/extending.md.
"""

import numpy as np

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.quality.figures import Figure
from gpis_grasp_planner.quality.measure import HeldPart, Measure


def lever(held: HeldPart) -> float:
    """Largest distance of a contact from the centre of mass [m]."""
    return float(np.linalg.norm(held.contacts.positions - held.center_of_mass, axis=1).max())


LEVER = Measure(
    Figure("lever", "m", False, "Largest distance of a contact from the centre of mass.", "-"),
    lever,
)

part = MeshCatalogue([default_catalogue_directory()]).load("mug")
planner = GraspPlanner()
result = planner.plan(part, PlanRequest(time_budget_s=3.0))
edges = planner.settings.scene.cone_edges
print(result.code.name, result.message)
values = [
    LEVER.of(
        HeldPart(
            grasp.contacts, part.center_of_mass, part.max_radius, edges,
            grasp.T_object_palm, grasp.joints,
        )
    )
    for grasp in result.grasps
]  # fmt: skip
for row in np.argsort(values)[:3]:
    print(
        f"{LEVER.figure.name} {1e3 * values[row]:.1f} mm, epsilon {result.grasps[row].epsilon:.3f}"
    )
