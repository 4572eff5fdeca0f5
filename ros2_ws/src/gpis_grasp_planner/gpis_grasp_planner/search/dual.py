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

from gpis_grasp_planner.search.contacts.contact_first import ContactFirst
from gpis_grasp_planner.search.hpp_opt import PalmPoseOptimiser
from gpis_grasp_planner.search.refinement.contact_refinement import ContactRefinement

if TYPE_CHECKING:
    from gpis_grasp_planner.search.context import PlanningContext

# The list wants the best: by their plain sum many weak grasps would outweigh a few strong ones.
_FOR_THE_BEST = 3
_PRIOR = 30.0  # hands' worth of belief that both kinds are alike


class DualOptimiser:
    """HPP-Opt and contact refinement in turn, and within the first stage palms and contacts.

    Turns are given by the number of attempts, not by the clock, so that a run is repeatable.
    Proposals that begin with the contacts get their share, or less where their attempts are worth
    less than those of the palms: on a table with a flat part on it they mostly are.
    """

    def __init__(self, context: PlanningContext):
        self._evaluator = context.evaluator
        self._objective = context.objective
        self._share = context.settings.dual.second_stage_share
        self._batch = context.settings.hpp.batch
        self._settings = context.settings.contacts
        self._first = PalmPoseOptimiser(context)
        self._contacts = ContactFirst(context)
        self._second = ContactRefinement(context)
        self._attempts = [0, 0]
        # Of palms and of contacts: hands of the first stage, and the sum of a power of
        # their objectives.
        self._tried = [0, 0]
        self._worth = [0.0, 0.0]

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
            self._propose()
        self._attempts[turn] += self._evaluator.n_attempts - before

    def _propose(self) -> None:
        """A batch of the kind of proposal that is behind its share."""
        before = self._evaluator.n_attempts
        kind = int(self._tried[1] < self._contact_share * sum(self._tried) and self._contacts.able)
        if kind:
            attempts, owner = self._contacts.attempt(self._batch)
            # What constraints did not even let close has been tried, too.
            spent = self._batch * self._settings.n_seed
            if self._settings.tell_model:
                self._first.tell_attempts(attempts, owner)
        else:
            proposals = self._first.propose(self._batch)
            self._first.tell(proposals)
            attempts = proposals.attempts
            spent = self._evaluator.n_attempts - before
        self._second.consider(attempts)
        self._tried[kind] += spent
        value = attempts.objective_of_grasps(self._objective)
        self._worth[kind] += float((value**_FOR_THE_BEST).sum())

    @property
    def _contact_share(self) -> float:
        """The share that contacts get now: as set, or less by how much less they are worth."""
        mean = sum(self._worth) / max(sum(self._tried), 1)
        if mean <= 0.0:
            return self._settings.share
        palms, contacts = (
            (worth + _PRIOR * mean) / (tried + _PRIOR)
            for worth, tried in zip(self._worth, self._tried, strict=True)
        )
        return self._settings.share * min(1.0, contacts / palms)
