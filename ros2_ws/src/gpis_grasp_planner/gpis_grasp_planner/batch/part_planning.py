"""How every part of a catalogue is planned: the one way, for jobs here and on other machines."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.store.conditions import Conditions
from gpis_grasp_planner.store.record import Record
from gpis_grasp_planner.surroundings.place import Place

# A part that takes longer than this beside its budget hangs: reading, preparing, trials.
_BESIDE_BUDGET_S = 300.0
_TIMES_BUDGET = 3.0


@dataclass(frozen=True, eq=False)
class PartPlanning:
    """With this and a part, any process makes the same plan; plain values, which can be sent.

    Attributes
    ----------
    settings : PlannerSettings
    request : PlanRequest
    on_lowest : bool
        Whether the part stands on its lowest point; else it floats.
    """

    settings: PlannerSettings
    request: PlanRequest
    on_lowest: bool = False

    @property
    def limit_s(self) -> float:
        """After this time a part is given up [s]."""
        return _BESIDE_BUDGET_S + _TIMES_BUDGET * self.request.time_budget_s

    def place(self, part: Part) -> Place:
        """Where the part lies."""
        if not self.on_lowest:
            return Place()
        lowest = [0.0, 0.0, float(part.mesh.bounds[0][2])]
        return Place.from_mapping({"support": {"point": lowest}})

    def conditions(self, part: Part, hand: HandDescription) -> Conditions:
        """What a plan of the part depends on, but for its place."""
        return Conditions.of(part, self.request, self.settings, hand)

    def content_hash(self, part: Part, hand: HandDescription) -> str:
        """SHA-256 (hex) of everything that the part's plan depends on; the mesh by its content."""
        request = self.request
        rest = (request.time_budget_s, request.n_grasps, self.on_lowest)
        return hashlib.sha256(f"{self.conditions(part, hand).key} {rest}".encode()).hexdigest()

    def plan(self, planner: GraspPlanner, part: Part) -> Record:
        """Plan a part, with nothing known before: a result depends on part and request alone.

        Parameters
        ----------
        planner : GraspPlanner
            Of these settings.
        part : Part

        Raises
        ------
        GraspPlannerError
            Of the planner.
        """
        result = planner.answer(part, self.request, self.place(part)).result
        return Record(result, self.conditions(part, planner.hand))
