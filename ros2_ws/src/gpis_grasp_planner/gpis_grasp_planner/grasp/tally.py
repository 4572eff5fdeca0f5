"""Counts proposals and losses where they happen, and keeps some of the palms that were lost."""

from __future__ import annotations

from collections import Counter
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.evaluator import Attempts, AttemptStatus
from gpis_grasp_planner.grasp.funnel import Funnel, Loss, Step
from gpis_grasp_planner.grasp.lost_palms import EvenSample, LostPalms

Array = NDArray[np.float64]


class Tally:
    """What was proposed and lost so far.

    Attributes
    ----------
    proposed : int
    lost : Counter of (Step, cause)
    """

    def __init__(self) -> None:
        self.proposed = 0
        self.lost: Counter[tuple[Step, str]] = Counter()
        self._palms: dict[tuple[Step, str], EvenSample] = {}

    def copy(self) -> Self:
        """The counts of now, without the palms."""
        made = type(self)()
        made.proposed, made.lost = self.proposed, self.lost.copy()
        return made

    def lose(self, step: Step, cause: str, n: int = 1) -> None:
        """Count what was lost; 0 leaves no trace."""
        if n:
            self.lost[step, str(cause)] += n

    def lose_at(self, step: Step, cause: str, T_object_palm: Array) -> None:
        """Count hands that were lost at poses (n, 4, 4), and keep some of these."""
        self.lose(step, cause, len(T_object_palm))
        if len(T_object_palm):
            sample = self._palms.setdefault((step, str(cause)), EvenSample())
            sample.add(T_object_palm[:, :3, 3])

    def propose(self, attempts: Attempts) -> None:
        """Count hands that were closed, or that nobody let close, and what they came to.

        Those whose status is `BLOCKED` are proposals here; whoever blocked them counts the loss.
        """
        status, T = attempts.status, attempts.T_object_palm
        self.proposed += int(np.count_nonzero(status != AttemptStatus.NOT_TRIED))
        few = status == AttemptStatus.TOO_FEW_CONTACTS
        none = few & (attempts.n_contacts == 0)
        slack = (status == AttemptStatus.GRASPED) & (attempts.epsilon <= 0.0)
        for step, cause, lost in (
            (Step.PALM_FREE, Loss.PALM, status == AttemptStatus.PALM_COLLISION),
            (Step.CLOSED, Loss.ITSELF, status == AttemptStatus.SELF_COLLISION),
            (Step.ENOUGH_CONTACTS, Loss.NOTHING, none),
            (Step.ENOUGH_CONTACTS, Loss.ONE, few & ~none),
            (Step.FORCE_CLOSURE, Loss.SLACK, slack),
            (Step.CLEAR, Loss.WAY_BACK, status == AttemptStatus.NO_WAY_BACK),
        ):
            self.lose_at(step, cause, T[lost])

    def reject(self, T_object_palm: Array, free: NDArray[np.bool_]) -> None:
        """Count palms (n, 4, 4) without a free place; the free ones count once they close."""
        self.proposed += int(np.count_nonzero(~free))
        self.lose_at(Step.PALM_FREE, Loss.DEEP, T_object_palm[~free])

    def take_over(self, n: int) -> None:
        """Count grasps of an earlier answer: they were proposed, and passed up to `DISTINCT`."""
        self.proposed += n

    def funnel(self, last: Step) -> Funnel:
        """What was counted so far."""
        return Funnel(self.proposed, dict(self.lost), last)

    @property
    def lost_palms(self) -> LostPalms:
        """Some of the palms of each cause, in the order of the steps."""
        order = list(Step)
        found = sorted(self._palms.items(), key=lambda item: order.index(item[0][0]))
        return LostPalms({key: sample.rows for key, sample in found})
