"""Alg. 4 as the paper has it: ADMM-CP-Opt after every proposal of the palm's model.

One iteration: expected improvement proposes one palm pose, the local adaption finds a grasp
near it, ADMM-CP-Opt starts from that grasp, and the better of the two is told to the model at the
pose where it was found. (Printed is the first stage's value with the second stage's pose.)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gpis_grasp_planner.search.admm_cp_opt import ContactPointOptimiser, CpOptResult
from gpis_grasp_planner.search.hpp_opt import PalmPoseOptimiser

if TYPE_CHECKING:
    from gpis_grasp_planner.search.context import PlanningContext


class PaperDualOptimiser:
    """HPP-Opt and ADMM-CP-Opt alternate, one proposal at a time.

    Attributes
    ----------
    runs, converged, improved : int
        Seeds of ADMM-CP-Opt so far, how many met their tolerances, and how many of the realised
        grasps were better than the grasp they started from.
    """

    def __init__(self, context: PlanningContext):
        self._context = context
        self._first = PalmPoseOptimiser(context)
        self._second = ContactPointOptimiser(context)
        self.runs = 0
        self.converged = 0
        self.improved = 0

    @property
    def finished(self) -> bool:
        """Whether n_iter proposals were made."""
        return self._first.finished

    def step(self) -> None:
        """One iteration of Alg. 4."""
        proposals = self._first.propose(1)
        best = int(proposals.best[0])
        if best >= 0 and proposals.values[0] > 0.0:
            results = self._second.optimise(
                proposals.attempts.T_object_palm[best], proposals.attempts.joints[best]
            )
            for result in results:
                self._count(result, float(proposals.values[0]))
                value = self._value(result)
                if value > proposals.values[0]:
                    proposals.values[0] = value
                    T_face = result.T_object_palm @ self._context.T_palm_face
                    proposals.T_object_face[0] = T_face
        self._first.tell(proposals)

    def _count(self, result: CpOptResult, first_stage: float) -> None:
        self.runs += 1
        self.converged += result.converged
        self.improved += self._value(result) > first_stage

    def _value(self, result: CpOptResult) -> float:
        return float(np.max(result.realised.objective(self._context.objective)))
