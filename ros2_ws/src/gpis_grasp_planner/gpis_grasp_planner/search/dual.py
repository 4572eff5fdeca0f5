"""Dual optimisation (Alg. 4): palm pose and contacts optimised in turn, in one budget.

Two forms:

- `DualOptimiser` (planner "dual"): HPP-Opt and the contact refinement share the time. Whatever
  the first stage finds may be refined. This is the default.
- `PaperDualOptimiser` in `paper_dual` (planner "paper"): Alg. 4 as printed, with ADMM-CP-Opt after
  every proposal.

Both put every attempt in one archive, so that the answer is never worse than the first stage's.
Slip in the paper: Alg. 4 stores the value of the first stage with the pose of the second; here a
value is always told with the pose it was found at.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gpis_grasp_planner.search.hpp_opt import PalmPoseOptimiser
from gpis_grasp_planner.search.refinement.contact_refinement import ContactRefinement

if TYPE_CHECKING:
    from gpis_grasp_planner.search.context import PlanningContext


class DualOptimiser:
    """HPP-Opt and contact refinement in turn.

    Turns are given by the number of attempts, not by the clock, so that a run is repeatable.
    """

    def __init__(self, context: PlanningContext):
        self._evaluator = context.evaluator
        self._share = context.settings.dual.second_stage_share
        self._batch = context.settings.hpp.batch
        self._first = PalmPoseOptimiser(context)
        self._second = ContactRefinement(context)
        self._attempts = [0, 0]

    @property
    def finished(self) -> bool:
        """Never before its caller stops it, unless the first stage ends without any grasp."""
        return self._first.finished and not self._second.ready

    def step(self) -> None:
        """One step of the stage that is behind its share."""
        first, second = self._attempts
        behind = second * (1.0 - self._share) < first * self._share
        turn = 1 if self._first.finished or (self._second.ready and behind) else 0
        before = self._evaluator.n_attempts
        if turn:
            self._second.step()
        else:
            proposals = self._first.propose(self._batch)
            self._first.tell(proposals)
            self._second.consider(proposals.attempts)
        self._attempts[turn] += self._evaluator.n_attempts - before
