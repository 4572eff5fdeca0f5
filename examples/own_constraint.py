"""A rule of your own that grasps must respect: contacts near the height of the centre of mass.

For the command line and the node the rule is registered by an entry point: docs/extending.md.
"""

import numpy as np

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.grasp.constraint import ClosedHands, Constraint, Verdict
from gpis_grasp_planner.plan.own_constraints import Situation
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings

BAND_M = 0.025


class NearTheMiddle(Constraint):
    """No contact is farther from the centre of mass than the band, along the part's z."""

    name = "height of contacts"

    def __init__(self, situation: Situation):
        self._z = situation.part.center_of_mass[2]

    def verdict(self, closed: ClosedHands) -> Verdict:
        """Look at the contacts of each closed hand."""
        verdict = Verdict.clear(len(closed))
        for row, n in enumerate(closed.n_contacts):
            if np.any(np.abs(closed.positions[row, :n, 2] - self._z) > BAND_M):
                verdict.cause[row] = self.name
        return verdict


part = MeshCatalogue([default_catalogue_directory()]).load("mug")
settings = PlannerSettings.from_mapping({"constraints": {"names": [f"{__name__}:NearTheMiddle"]}})
result = GraspPlanner(settings).plan(part, PlanRequest(time_budget_s=4.0))
print(result.code.name, result.message)
heights = [grasp.contacts.positions[:, 2] - part.center_of_mass[2] for grasp in result.grasps]
print(f"farthest contact {1e3 * max(np.abs(z).max() for z in heights):.1f} mm from the middle")
