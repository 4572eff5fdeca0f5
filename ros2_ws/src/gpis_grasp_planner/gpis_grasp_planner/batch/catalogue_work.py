"""A catalogue that is planned into the grasp store: what is kept before is not planned again."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from gpis_grasp_planner.batch.outcome import Outcome
from gpis_grasp_planner.batch.part_planning import PartPlanning
from gpis_grasp_planner.errors import GraspPlannerError
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanResult
from gpis_grasp_planner.store.grasp_store import KEPT_CODES, GraspStore
from gpis_grasp_planner.store.record import Record


@dataclass(frozen=True, eq=False)
class CatalogueWork:
    """What is to be done with every part.

    Attributes
    ----------
    planning : PartPlanning
    planner : GraspPlanner
        Of the settings of `planning`.
    store : GraspStore
    catalogue : MeshCatalogue
    again : bool
        Whether parts that had no grasp are planned anew.
    draw : callable or None
        Draws a part's best grasp; returns the name of the picture, empty where there is none.
    """

    planning: PartPlanning
    planner: GraspPlanner
    store: GraspStore
    catalogue: MeshCatalogue
    again: bool = False
    draw: Callable[[Part, PlanResult], str] | None = None

    def do(self, mesh_id: str) -> Outcome:
        """Plan one part in this process, or find that it is planned."""
        began = time.monotonic()
        try:
            part = self.catalogue.load(mesh_id)
            outcome = self.found(part, began)
            if outcome is None:
                outcome = self.keep(part, self.planning.plan(self.planner, part), began)
        except GraspPlannerError as error:
            return Outcome.failed(mesh_id, error, time.monotonic() - began)
        return outcome

    def found(self, part: Part, began: float) -> Outcome | None:
        """The outcome of a part that was planned before; None where it has to be planned.

        Parameters
        ----------
        part : Part
        began : float [s]
            When the work on it began (`time.monotonic`).
        """
        planning = self.planning
        # Plans for other places take no part: a result depends on part and request alone.
        found = self.store.find(
            part,
            planning.conditions(part, self.planner.hand),
            planning.request,
            planning.place(part),
            elsewhere=False,
            failures=not self.again,
        )
        if found is None:
            return None
        self.store.note_uses()
        return self._outcome(part, found.record.result, began, from_store=True, kept=True)

    def keep(self, part: Part, record: Record, began: float) -> Outcome:
        """Keep the plan that was made of a part, and say what came of it; see :meth:`found`."""
        kept = record.result.code in KEPT_CODES and self.store.put(record)
        return self._outcome(part, record.result, began, from_store=False, kept=kept)

    def _outcome(
        self, part: Part, result: PlanResult, began: float, *, from_store: bool, kept: bool
    ) -> Outcome:
        spent = time.monotonic() - began
        outcome = Outcome.of(result, from_store=from_store, kept=kept, elapsed_s=spent)
        if self.draw is None:
            return outcome
        return replace(outcome, picture=self.draw(part, result))
