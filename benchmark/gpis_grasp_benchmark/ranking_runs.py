"""One object of the ranking study: which order of an answer's grasps stands a displaced part.

The object is planned on once. The best of the answer are ordered by epsilon, by the model's
probability under the pose's covariance, and by trials in physics on some displacements; then every
one of them is tried on other displacements, the same for all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_benchmark.runs import Record
from gpis_grasp_benchmark.study_runs import ObjectRun, study_environment
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.plan.document import document_text
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.plan.warm_up import warm_up
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.surroundings.hold_probability import HoldEstimate, rank_under_uncertainty
from gpis_grasp_planner.surroundings.uncertainty_settings import UncertaintySettings
from gpis_grasp_planner.verification.pose_noise import displacements
from gpis_grasp_planner.verification.protocol import verify
from gpis_grasp_planner.verification.settings import VerificationSettings

Array = NDArray[np.float64]

_SELECTING_SEED_OFFSET = 1
_TRIALS_S = 900.0

# The model as it is set, and what its settings do.
MODELS: Mapping[str, Mapping[str, object]] = {
    "as set": {},
    "a miss where the palm meets the part": {"give_way_m": 0.0, "draw_in_m": 0.0},
    "guarded approach, not drawn in": {"draw_in_m": 0.0},
    "epsilon > 0.05": {"min_epsilon": 0.05},
    "epsilon > 0.1": {"min_epsilon": 0.1},
    "sigma points": {"method": "unscented"},
}


@dataclass(frozen=True)
class RankingRun(ObjectRun):
    """Everything that decides what comes of one object, but for the clock.

    Attributes
    ----------
    tried : int
        Grasps of the answer that are ordered anew, the best by epsilon and volume.
    displacements : int
        On which every one of them is tried.
    selecting : int
        Further displacements, by which the order "by trials" is made.
    noise_seed : int
    """

    tried: int = 8
    displacements: int = 20
    selecting: int = 5
    noise_seed: int = 20_000

    @property
    def longest_s(self) -> float:
        """The plan and all trials, some of which take 10 s."""
        trials = self.tried * (self.displacements + self.selecting)
        return self.plan.longest_s + _TRIALS_S + 5.0 * trials

    def identity(self) -> Record:
        """What a finished run is recognised by."""
        return {
            "protocol": "ranking",
            **super().identity(),
            "tried": self.tried,
            "displacements": self.displacements,
            "selecting": self.selecting,
            "noise_seed": self.noise_seed,
        }

    def make(self, part: Part) -> tuple[Record, str]:
        """Plan, estimate and try in this process."""
        here = study_environment()
        warm_up([self.plan.planner])
        planner = GraspPlanner(PlannerSettings.from_mapping(self.plan.settings))
        settings = planner.settings.verification
        result = planner.plan(part, self.plan.request())
        grasps = result.grasps[: self.tried]
        rows: list[Record] = [
            {"epsilon": float(g.epsilon), "volume": float(g.volume)} for g in grasps
        ]
        if grasps:
            for model, estimates in self._estimates(planner, part, grasps).items():
                for row, estimate in zip(rows, estimates, strict=True):
                    row.setdefault("probability", {})[model] = estimate.probability
                    row.setdefault("quality", {})[model] = estimate.expected_quality
            self._try(part, planner.hand, grasps, settings, rows)
        return {
            "key": self.key,
            **self.identity(),
            "settings": {group: dict(values) for group, values in self.plan.settings.items()},
            "extent_m": [float(side) for side in part.mesh.extent],
            "status": result.code.name,
            "elapsed_s": float(result.elapsed_s),
            "evaluations": int(result.evaluations),
            "grasps": rows,
            "environment": here,
        }, document_text(result)

    def _estimates(
        self, planner: GraspPlanner, part: Part, grasps: Sequence[Grasp]
    ) -> dict[str, list[HoldEstimate]]:
        settings = planner.settings
        prepared = planner.prepare(part)
        friction = Friction(settings.verification.friction, settings.verification.friction)
        evaluator = CompiledEvaluator(
            planner.hand, part, friction, settings.scene, prepared.field, prepared.tree
        )
        covariance = noise_covariance(part, settings.verification)
        found = {}
        for model, changes in MODELS.items():
            used = UncertaintySettings.from_mapping({**settings.uncertainty.as_dict(), **changes})
            rng = np.random.default_rng(self.plan.seed)
            _, found[model] = rank_under_uncertainty(
                evaluator, planner.hand, grasps, covariance, used, rng
            )
        return found

    def _try(
        self,
        part: Part,
        hand: HandDescription,
        grasps: Sequence[Grasp],
        settings: VerificationSettings,
        rows: Sequence[Record],
    ) -> None:
        for row, verdict in zip(rows, verify(part, hand, grasps, settings), strict=True):
            row["held"], row["cause"] = verdict.held, verdict.cause
        for name, n, seed in (
            ("trials", self.displacements, self.noise_seed),
            ("selecting", self.selecting, self.noise_seed + _SELECTING_SEED_OFFSET),
        ):
            moves = displacements(part, replace(settings, noise_repeats=n), seed)
            tried = [grasp for grasp in grasps for _ in moves]
            found = verify(part, hand, tried, settings, displacements=moves * len(grasps))
            for i, row in enumerate(rows):
                verdicts = found[n * i : n * (i + 1)]
                row[name] = [verdict.held for verdict in verdicts]
                row[f"{name}: causes"] = [verdict.cause for verdict in verdicts]
                row[f"{name}: elapsed_s"] = [verdict.elapsed_s for verdict in verdicts]


def noise_covariance(part: Part, settings: VerificationSettings) -> Array:
    """Covariance (6, 6) of the protocol's displacements, in the object's frame [m, rad].

    A shift of length d in a uniform direction has variance d^2 / 3 along each axis, and so has
    the turn, which is about the centre of mass c: the shift of the frame's origin is then
    ``shift + c x turn``. The model draws from the normal distribution of this covariance.
    """
    c = part.center_of_mass
    cross = np.array([[0.0, -c[2], c[1]], [c[2], 0.0, -c[0]], [-c[1], c[0], 0.0]])
    J = np.block([[np.eye(3), cross], [np.zeros((3, 3)), np.eye(3)]])
    shift = settings.noise_m**2 / 3.0
    turn = np.radians(settings.noise_deg) ** 2 / 3.0
    return np.asarray(J @ np.diag([shift] * 3 + [turn] * 3) @ J.T)
