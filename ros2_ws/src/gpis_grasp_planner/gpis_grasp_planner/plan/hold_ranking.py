"""How likely the grasps of an answer hold under the covariance of the part's pose."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.order import answer_rank
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.plan.kept_holds import KeptHolds
from gpis_grasp_planner.plan.objective import make_objective
from gpis_grasp_planner.plan.preparation import PreparedObject
from gpis_grasp_planner.plan.progress import Monitor
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.plan.surface_judge import SurfaceJudge
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.surroundings.covariance import check_covariance
from gpis_grasp_planner.surroundings.hold_probability import rank_under_uncertainty

_SECONDS_PER_SAMPLE = 0.002


@dataclass(frozen=True, eq=False)
class HoldRanking:
    """Estimates hold probabilities; without a covariance it has nothing to do.

    Attributes
    ----------
    part, hand, settings, prepared
    covariance : (6, 6) array or None
        Of the pose, in the object's axes.
    request : PlanRequest
        Its friction and its seed: all grasps meet the same perturbations.
    kept : KeptHolds
        Estimates of before, which are taken where the covariance is nearly the same.
    """

    part: Part
    hand: HandDescription
    settings: PlannerSettings
    prepared: PreparedObject
    covariance: NDArray[np.float64] | None
    request: PlanRequest
    kept: KeptHolds = field(default_factory=KeptHolds)

    @cached_property
    def on_surfaces(self) -> SurfaceJudge:
        """What tells whether grasps hold on the other surfaces of a scanned part."""
        return SurfaceJudge(self.part, self.hand, self.settings, self.prepared, self.request)

    @property
    def needed(self) -> bool:
        """Whether there is an uncertainty to rank under."""
        return self.covariance is not None and self.settings.uncertainty.method != "none"

    def candidates(self, n: int) -> int:
        """How many grasps to look at for an answer of `n`."""
        return max(n, self.settings.uncertainty.candidates) if self.needed else n

    def time_for(self, n: int) -> float:
        """What :meth:`ranked` takes for `n` grasps, about [s]."""
        return n * self.settings.uncertainty.samples * _SECONDS_PER_SAMPLE if self.needed else 0.0

    def ranked(
        self, grasps: Sequence[Grasp], deadline: float | None, monitor: Monitor
    ) -> tuple[list[Grasp], tuple[str, ...]]:
        """The grasps with their hold probability, in the order of `answer_rank`, and notes.

        Parameters
        ----------
        grasps : sequence of Grasp
            Best first: after the deadline the rest is left without.
        deadline : float or None
            By the monitor's clock; one grasp is always looked at.
        monitor : Monitor

        Raises
        ------
        PoseError
            INVALID_COVARIANCE.
        """
        if self.covariance is None or not self.needed or not grasps:
            return list(grasps), ()
        covariance = check_covariance(self.covariance)
        evaluator = CompiledEvaluator(
            self.hand,
            self.part,
            self.request.friction_for(self.part.friction),
            self.settings.scene,
            self.prepared.field,
            self.prepared.tree,
        )
        ranked: list[Grasp] = []
        n_known = 0
        for grasp in grasps:
            key = self._key(grasp)
            probability = self.kept.get(key, covariance)
            if probability is None:
                late = deadline is not None and monitor.now() > deadline
                if n_known and (late or monitor.stopped()):
                    ranked.append(grasp)
                    continue
                # One at a time for the deadline's sake; the seed gives all the same perturbations.
                _, [estimate] = rank_under_uncertainty(
                    evaluator,
                    self.hand,
                    [grasp],
                    covariance,
                    self.settings.uncertainty,
                    np.random.default_rng(self.request.seed),
                )
                probability = estimate.probability
                self.kept.put(key, covariance, probability)
            n_known += 1
            ranked.append(replace(grasp, hold_probability=probability))
        notes: tuple[str, ...] = ()
        if n_known < len(grasps):
            notes = (
                f"The time budget ended after the hold probability of {n_known} of "
                f"{len(grasps)} grasps.",
            )
        objective = make_objective(self.settings, self.part)
        return sorted(ranked, key=lambda grasp: answer_rank(grasp, objective)), notes

    def _key(self, grasp: Grasp) -> Hashable:
        """All that decides a grasp's probability under a covariance."""
        part = self.part
        return (
            part.mesh.content_hash,
            part.center_of_mass.tobytes(),
            self.request.friction_for(part.friction),
            self.request.seed,
            self.settings.uncertainty,
            self.settings.scene,
            grasp.T_object_palm.tobytes(),
            grasp.pregrasp_joints.tobytes(),
            grasp.contacts.links.tobytes(),
        )
