"""The distinct grasps found so far, refined in turn.

Who no longer improves has its turn less often: a hand pressed flat onto a face is as good as it
gets at once, in a dozen distinct ways, and would take the turns of the grasps that can still get
better.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gpis_grasp_planner.search.archive import Candidate
from gpis_grasp_planner.search.refinement.neighbourhood import Neighbourhood

if TYPE_CHECKING:
    from gpis_grasp_planner.search.context import PlanningContext

_MOST_FAILURES = 6


class ListRefinement:
    """Direct search over the archive's distinct grasps, best first.

    After k turns in a row that found nothing better a grasp sits out 2^k - 1 rounds, at most 63.
    What improves on it is another grasp, with a record of its own.

    Parameters
    ----------
    context : PlanningContext
        Its archive gives the grasps and takes what is found.
    neighbourhood : Neighbourhood
    """

    def __init__(self, context: PlanningContext, neighbourhood: Neighbourhood):
        self._archive = context.archive
        self._n = context.settings.refinement.n_grasps
        self._neighbourhood = neighbourhood
        self._queue: list[Candidate] = []
        self._failures: dict[Candidate, int] = {}
        self._rests: dict[Candidate, int] = {}

    def step(self) -> bool:
        """Try neighbours of the next grasp; False while the archive is empty."""
        if not self._queue:
            self._begin_round()
        if not self._queue:
            return False
        grasp = self._queue.pop()
        _, _, best = self._neighbourhood.attempt(grasp.T_object_palm, grasp.preshape)
        failures = 0 if best > grasp.objective else self._failures.get(grasp, 0) + 1
        self._failures[grasp] = min(failures, _MOST_FAILURES)
        self._rests[grasp] = 2 ** self._failures[grasp] - 1
        return True

    def _begin_round(self) -> None:
        listed = self._archive.best(self._n)
        rests = {grasp: self._rests.get(grasp, 0) for grasp in listed}
        shortest = min(rests.values(), default=0)
        self._queue = [grasp for grasp in reversed(listed) if rests[grasp] == shortest]
        self._rests = {grasp: rest - shortest - 1 for grasp, rest in rests.items()}
        self._failures = {g: self._failures[g] for g in listed if g in self._failures}
