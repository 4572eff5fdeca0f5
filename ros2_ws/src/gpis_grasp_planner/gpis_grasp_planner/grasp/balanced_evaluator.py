"""An evaluator that tells of each grasp whether the closing hand's own forces balance on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gpis_grasp_planner.grasp.evaluator import Attempts, AttemptStatus, PostureEvaluator
from gpis_grasp_planner.grasp.judging_evaluator import JudgingEvaluator
from gpis_grasp_planner.quality.closing_balance import ClosingBalance


class BalancedEvaluator(JudgingEvaluator):
    """An evaluator that tells the imbalance of what another one closed.

    Attempts with force closure get their `imbalance`, by which their objective is less
    (:func:`~gpis_grasp_planner.quality.balance_factor.balance_factor`).

    Parameters
    ----------
    evaluator : PostureEvaluator
    balance : ClosingBalance
        Of the same hand and part.

    Notes
    -----
    Some 0.05 to 0.1 ms for each attempt with force closure.
    """

    def __init__(self, evaluator: PostureEvaluator, balance: ClosingBalance):
        super().__init__(evaluator)
        self._balance = balance

    def judged(self, attempts: Attempts) -> Attempts:
        """The attempts with their imbalances."""
        closed = (attempts.status == AttemptStatus.GRASPED) & (attempts.epsilon > 0.0)
        imbalance = np.zeros(len(attempts))
        imbalance[closed] = self._balance.imbalance(
            attempts.T_object_palm[closed],
            attempts.joints[closed],
            attempts.n_contacts[closed],
            attempts.positions[closed],
            attempts.normals_inward[closed],
            attempts.friction[closed],
            attempts.links[closed],
        )
        return replace(attempts, imbalance=imbalance)
