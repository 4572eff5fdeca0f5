"""Grasps of a very fine mesh, found on its simplified one and closed again on all of it.

Closing a hand on a million triangles takes several times as long as on thirty thousand, and shows
the same grasps to a few hundredths of a millimetre. So the search closes on the simplified mesh
where that is near enough, and what may be answered is closed on the mesh itself: contacts, figures
and collisions of every answered grasp are of all triangles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpis_grasp_planner.grasp.evaluator import AttemptStatus, PostureEvaluator
from gpis_grasp_planner.grasp.open_hand import pregrasp_of
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.quality.objective import Objective
from gpis_grasp_planner.search.archive import Candidate

# How far a palm goes back that would lie in the mesh itself: as far as the two are apart, and more.
_BACK_M = (0.0, 5e-5, 1e-4, 2e-4)


@dataclass(frozen=True, eq=False)
class ExactClosing:
    """Closes candidates on the whole mesh.

    Attributes
    ----------
    evaluator : PostureEvaluator
        Of the whole mesh, with the constraints and measures of the search's.
    hand : HandDescription
    objective : Objective
    """

    evaluator: PostureEvaluator
    hand: HandDescription
    objective: Objective

    def __call__(self, candidate: Candidate) -> Candidate | None:
        """The candidate as it closes there; None if it is no grasp there.

        Its palm may lie up to 0.2 mm farther back along the approach. Some 10 ms for a million
        triangles, seldom up to 90.
        """
        attempts, index = candidate.attempts, candidate.index
        start = pregrasp_of(attempts, np.array([index]), self.hand)
        for back in _BACK_M:
            T = np.array(attempts.T_object_palm[index])[None]
            T[0, :3, 3] -= back * T[0, :3, 2]
            closed = self.evaluator.attempt_from(T, start)
            if closed.status[0] == AttemptStatus.GRASPED and closed.epsilon[0] > 0.0:
                return Candidate(closed, 0, float(closed.objective(self.objective)[0]))
            if closed.status[0] != AttemptStatus.PALM_COLLISION:
                return None
        return None
