"""What is asked of the planner, what it says on the way, and what it answers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.part import FRICTION_RANGE, Friction
from gpis_grasp_planner.grasp.funnel import Funnel
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.lost_palms import LostPalms
from gpis_grasp_planner.grasp.reserve import Reserve
from gpis_grasp_planner.grasp.trials import VERIFICATIONS
from gpis_grasp_planner.hand.open_hand import JointCount
from gpis_grasp_planner.quality.figures import ALWAYS, Figure
from gpis_grasp_planner.surroundings.approach_cone import ApproachCone
from gpis_grasp_planner.surroundings.forbidden_region import ForbiddenRegion

TIME_BUDGET_RANGE_S = (0.1, 600.0)
_MOMENT_S = 0.05
GRASP_COUNT_RANGE = (1, 200)
DEFAULT_FRICTION = Friction(finger=0.6, palm=0.6)
SEED_LIMIT = 2**63 - 1


@dataclass(frozen=True)
class PlanRequest:
    """One planning task, independent of the mesh and of where the part lies.

    Attributes
    ----------
    planner : str
        Name of the search, see ``search.searches.PLANNERS``.
    seed : int
        The same seed and evaluations give the same grasps; a time budget ends the search where
        the clock says, so that two runs agree up to the point where the slower one ended.
    time_budget_s : float [s]
    n_grasps : int
    friction : Friction or None
        None: that of the part, or the default of 0.6.
    max_evaluations : int or None
        Ends the search after this many attempts, which makes a run repeatable to the bit.
    approach : ApproachCone or None
        Directions from which the hand may come; None: from everywhere.
    forbidden : tuple of ForbiddenRegion
        Boxes in the part's frame that the hand must not touch.
    verification : str
        One of ``VERIFICATIONS``: whether finalists are tried in physics, within the budget.
    objective, task : str
        What a good grasp is, in place of the settings' `objective.name` and `objective.task`;
        empty: as those say. A task alone implies the objective ``task``.
    """

    planner: str = "dual"
    seed: int = 0
    time_budget_s: float = 5.0
    n_grasps: int = 20
    friction: Friction | None = None
    max_evaluations: int | None = None
    verification: str = "none"
    objective: str = ""
    task: str = ""
    approach: ApproachCone | None = None
    forbidden: tuple[ForbiddenRegion, ...] = ()

    @property
    def depends_on_pose(self) -> bool:
        """Whether a plan in free space is another one for another pose of the part."""
        return self.approach is not None and self.approach.frame == "world"

    def __post_init__(self) -> None:
        low, high = TIME_BUDGET_RANGE_S
        if not (math.isfinite(self.time_budget_s) and low <= self.time_budget_s <= high):
            raise RequestError(
                f"The time budget is {self.time_budget_s} s; allowed are {low:g} to {high:g} s. "
                "Ask again with a budget in that range.",
                ErrorCode.TIME_BUDGET_OUT_OF_RANGE,
            )
        few, many = GRASP_COUNT_RANGE
        if not few <= self.n_grasps <= many:
            raise RequestError(
                f"The number of grasps is {self.n_grasps}; allowed are {few} to {many}. "
                "Ask again with a number in that range.",
                ErrorCode.GRASP_COUNT_OUT_OF_RANGE,
            )
        if not 0 <= self.seed <= SEED_LIMIT:
            raise RequestError(f"The seed is {self.seed}; give an integer from 0 to {SEED_LIMIT}.")
        if self.max_evaluations is not None and self.max_evaluations < 1:
            raise RequestError(
                f"The limit of evaluations is {self.max_evaluations}; give at least 1, or none."
            )
        if self.verification not in VERIFICATIONS:
            raise RequestError(
                f"The verification is '{self.verification}'; choose one of "
                f"{', '.join(VERIFICATIONS)}.",
                ErrorCode.INVALID_SETTING,
            )
        for name in ("finger", "palm"):
            if self.friction is not None:
                check_friction(getattr(self.friction, name), name)

    def again(self, spent_s: float) -> PlanRequest:
        """The same request for a search that has to be made anew after `spent_s` [s].

        It gets what is left of the time budget, but at least half of it: where the first search
        has used it up, an answer is late rather than missing. A moment (50 ms) changes nothing: the
        store knows the request again.
        """
        if spent_s <= _MOMENT_S:
            return self
        left = max(self.time_budget_s - spent_s, 0.5 * self.time_budget_s, TIME_BUDGET_RANGE_S[0])
        return replace(self, time_budget_s=left)

    def friction_for(self, part_friction: Friction | None) -> Friction:
        """The request's friction, else the part's, else the default."""
        return self.friction or part_friction or DEFAULT_FRICTION


def check_friction(value: float, where: str) -> float:
    """Return a coefficient of friction, or raise RequestError with the allowed range."""
    low, high = FRICTION_RANGE
    if not (math.isfinite(value) and low <= value <= high):
        raise RequestError(
            f"The friction of the {where} is {value}; allowed are {low:g} to {high:g}. "
            "Ask again with a coefficient in that range.",
            ErrorCode.FRICTION_OUT_OF_RANGE,
        )
    return float(value)


@dataclass(frozen=True, eq=False)
class PlanResult:
    """The answer, with everything that is needed to recompute its figures.

    Attributes
    ----------
    code : ErrorCode
        SUCCESS, or why there is none (NO_FEASIBLE_GRASP, ALL_GRASPS_BLOCKED, NO_GRASP_HOLDS);
        CANCELLED may come with the grasps that were finished.
    message : str
    grasps : tuple of Grasp
        With force closure, mutually distinct, best first, in the object's frame.
    best_attempt : Grasp or None
        Where there is no grasp: the nearest thing to one. Infeasible.
    joint_count : JointCount
        How the hand's URDF counts the joints; the grasps' are counted from the open hand.
    convergence : tuple of (elapsed s, evaluations, best epsilon)
        One entry per improvement of the best epsilon.
    place : mapping or None
        The place that the answer is for, in the form of `surroundings.place.Place`; None for a
        plan in free space.
    objective : str
        What the search maximised, as a formula.
    figures : tuple of Figure
        What the figures of the grasps' qualities mean.
    phase_s : mapping of phase to seconds
        How long each phase of the request took (`plan.progress.Phase`).
    funnel : Funnel
        Where grasps were lost on the way to this answer.
    lost_palms : LostPalms
        Some of their places in space, by cause.
    reserve : Reserve
        Further grasps, for surroundings in which those of the answer are blocked.
    """

    code: ErrorCode
    message: str
    grasps: tuple[Grasp, ...]
    best_attempt: Grasp | None
    mesh_id: str
    mesh_hash: str
    center_of_mass: NDArray[np.float64]
    torque_scale: float
    mass: float
    cone_edges: int
    contact_threshold: float
    friction: Friction
    hand: str
    link_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    joint_count: JointCount
    request: PlanRequest
    settings: Mapping[str, Any]
    elapsed_s: float
    evaluations: int
    notes: tuple[str, ...] = ()
    convergence: tuple[tuple[float, int, float], ...] = field(default=())
    place: Mapping[str, Any] | None = None
    reserve: Reserve = field(default_factory=Reserve)
    phase_s: Mapping[str, float] = field(default_factory=dict)
    funnel: Funnel = field(default_factory=Funnel)
    lost_palms: LostPalms = field(default_factory=LostPalms)
    objective: str = ""
    figures: tuple[Figure, ...] = ALWAYS

    @property
    def success(self) -> bool:
        """Whether the answer is complete: code SUCCESS."""
        return self.code == ErrorCode.SUCCESS
