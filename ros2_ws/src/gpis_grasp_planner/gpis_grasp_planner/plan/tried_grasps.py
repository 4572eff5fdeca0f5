"""The grasps of an answer after their trials: in what order, and what to say of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.order import answer_rank, distinct
from gpis_grasp_planner.quality.objective import Objective
from gpis_grasp_planner.verification.running_trials import RunningTrials
from gpis_grasp_planner.verification.settings import VerificationSettings


def payload_note(part: Part, settings: VerificationSettings) -> tuple[str, ...]:
    """What is to be said of a part that the hand cannot carry: its trials were of a lighter one."""
    if part.mass <= settings.payload_kg:
        return ()
    return (
        f"'{part.mesh_id}' weighs {part.mass:.3g} kg, more than the payload of "
        f"{settings.payload_kg:g} kg: its trials were made with {settings.mass_kg:g} kg, and "
        "what held there need not hold the part. Set the density if it is lighter.",
    )


@dataclass(frozen=True, eq=False)
class TriedGrasps:
    """Grasps that may be answered, each with what physics said of it.

    Attributes
    ----------
    ranked : tuple of Grasp
        By `answer_rank`: what held, then what was not tried, then what failed.
    n_lost : int
        Trials whose process died or hung.
    """

    ranked: tuple[Grasp, ...]
    n_lost: int = 0

    @classmethod
    def of(
        cls,
        grasps: Sequence[Grasp],
        trials: RunningTrials,
        max_radius: float,
        objective: Objective,
    ) -> TriedGrasps:
        """Rank finished grasps, and keep of each neighbourhood the first.

        Parameters
        ----------
        grasps : sequence of Grasp
        trials : RunningTrials
        max_radius : float [m]
            Scale of the distance rule.
        objective : Objective
        """
        tried = [trials.with_trials(grasp) for grasp in grasps]
        tried.sort(key=lambda grasp: answer_rank(grasp, objective))
        if not tried:
            return cls((), trials.n_lost)
        T = np.stack([grasp.T_object_palm for grasp in tried])
        chosen = distinct(T, np.arange(len(tried)), max_radius, len(tried))
        return cls(tuple(tried[i] for i in chosen), trials.n_lost)

    @property
    def held(self) -> tuple[Grasp, ...]:
        """Those that were seen to hold."""
        return tuple(g for g in self.ranked if g.trials is not None and g.trials.held)

    @property
    def n_tried(self) -> int:
        """How many were tried."""
        return sum(grasp.trials is not None for grasp in self.ranked)

    @property
    def notes(self) -> tuple[str, ...]:
        """How many were tried, and how many of those held; none where nothing was to be tried."""
        lost = f"{self.n_lost} trials were lost with their process."
        said = (lost,) if self.n_lost else ()
        if not self.ranked:
            return said
        if not self.n_tried:
            return (
                "No grasp could be tried in physics within the time budget. Give more time.",
                *said,
            )
        untried = len(self.ranked) - self.n_tried
        left = f"; there was no time to try {untried} more" if untried else ""
        s = "" if self.n_tried == 1 else "s"
        return (
            f"Tried in physics: {self.n_tried} grasp{s}, of which {len(self.held)} held{left}.",
            *said,
        )

    @property
    def why_none(self) -> str:
        """Causes and their numbers, for the case that nothing held; how many were not tried."""
        if not self.n_tried:
            return "none could be tried within the time budget"
        causes = Counter(g.trials.outcomes[0].cause for g in self.ranked if g.trials is not None)
        counted = [f"{cause} {n}" for cause, n in causes.most_common()]
        if untried := len(self.ranked) - self.n_tried:
            counted.append(f"not tried {untried}")
        return ", ".join(counted)
