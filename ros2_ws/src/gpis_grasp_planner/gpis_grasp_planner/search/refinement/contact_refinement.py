"""Second stage, improved: the contacts of good grasps refined by direct search.

The paper's second stage (`admm_cp_opt`) optimises the finger joints with the palm on a chart and
has to bring the contacts back onto the surface by a penalty. Closing the hand does that by
construction: with the palm and the spread given, AutoGrasp and the drive's coupling leave one
posture, whose contacts lie on the surface exactly. What is free is where the palm lies and how
the fingers are spread, and that is searched here, in three ways that take turns:

- the distinct grasps found so far, moved a little and closed anew (`list_refinement`);
- grasps of the first stage that are not among them, most of them given up early
  (`start_tournament`);
- images of the best under the symmetries that the part nearly has (`grasp_images`).

One step tries `samples` neighbours or up to 24 images, 10 to 50 ms.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from gpis_grasp_planner.grasp.evaluator import Attempts
from gpis_grasp_planner.search.refinement.grasp_images import GraspImages
from gpis_grasp_planner.search.refinement.list_refinement import ListRefinement
from gpis_grasp_planner.search.refinement.neighbourhood import Neighbourhood
from gpis_grasp_planner.search.refinement.start_tournament import StartTournament

if TYPE_CHECKING:
    from gpis_grasp_planner.search.context import PlanningContext


class ContactRefinement:
    """Turns of the three searches, by their shares.

    Parameters
    ----------
    context : PlanningContext
        Its archive gives the grasps and takes what is found.
    """

    def __init__(self, context: PlanningContext):
        self._context = context
        s = context.settings.refinement
        neighbourhood = Neighbourhood(context)
        self._tournament = StartTournament(context, neighbourhood)
        listed = 1.0 - s.tournament_share - s.image_share
        self._turns: list[tuple[float, Callable[[], bool]]] = [
            (listed, ListRefinement(context, neighbourhood).step),
            (s.tournament_share, self._tournament.step),
            (s.image_share, GraspImages(context).step),
        ]
        self._taken = [0] * len(self._turns)

    @property
    def ready(self) -> bool:
        """Whether there is anything to refine."""
        return len(self._context.archive) > 0

    def consider(self, attempts: Attempts) -> None:
        """Take attempts of the first stage as possible starts."""
        self._tournament.consider(attempts)

    def step(self) -> None:
        """One turn of the search that is farthest behind; does nothing while there is no grasp.

        A search that has nothing to do forgoes its turn.
        """
        if not self.ready:
            return
        behind = [
            ((taken + 1) / share, k)
            for k, (taken, (share, _)) in enumerate(zip(self._taken, self._turns, strict=True))
            if share > 0.0
        ]
        for _, k in sorted(behind):
            self._taken[k] += 1
            if self._turns[k][1]():
                return
