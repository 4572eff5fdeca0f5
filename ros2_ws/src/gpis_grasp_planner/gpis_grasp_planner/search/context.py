"""Everything a search works on, and the interface of a search."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.constraint import Constraint
from gpis_grasp_planner.grasp.evaluator import GraspEvaluator, PostureEvaluator
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.quality.measure import Measure
from gpis_grasp_planner.quality.objective import Objective
from gpis_grasp_planner.search.archive import GraspArchive
from gpis_grasp_planner.search.preshape_range import PreshapeRange
from gpis_grasp_planner.search.settings import SearchSettings
from gpis_grasp_planner.surface.atlas import SurfaceAtlas


@dataclass(frozen=True, eq=False)
class PlanningContext:
    """One object, hand and friction, ready to be searched.

    `archive` takes every attempt a search makes; the answer is chosen from it. `rng` is the only
    source of randomness. `constraints` are what grasps must respect; the evaluator knows them too.
    `reported` are the measures whose figures a finished grasp has.
    """

    part: Part
    hand: HandDescription
    evaluator: GraspEvaluator
    atlas: SurfaceAtlas
    archive: GraspArchive
    settings: SearchSettings
    rng: np.random.Generator
    constraints: tuple[Constraint, ...] = ()
    reported: tuple[Measure, ...] = ()

    @property
    def objective(self) -> Objective:
        """What the search maximises: that of the archive."""
        return self.archive.objective

    @property
    def max_radius(self) -> float:
        """Distance of the object's farthest point from its centre of mass [m]."""
        return self.part.max_radius

    @property
    def preshapes(self) -> PreshapeRange:
        """What is drawn of the hand's pre-shape."""
        return PreshapeRange.of(self.hand, self.settings.adaption.spread_max_deg)

    @property
    def T_palm_face(self) -> NDArray[np.float64]:
        """Pose of the middle of the palm's face in the palm frame (4, 4); only z differs."""
        T = np.eye(4)
        T[2, 3] = palm_face_height(self.hand)
        return T


def posture_evaluator(context: PlanningContext) -> PostureEvaluator:
    """The context's evaluator, if it takes postures; else RequestError."""
    if not isinstance(context.evaluator, PostureEvaluator):
        raise RequestError(
            "This planner needs an evaluator of postures, and "
            f"{type(context.evaluator).__name__} is none; use the compiled evaluator."
        )
    return context.evaluator


class Search(Protocol):
    """A planner's search: a loop that its caller drives and may stop after any step."""

    @property
    def finished(self) -> bool:
        """Whether the search has nothing more to do."""
        ...

    def step(self) -> None:
        """Do a small piece of work (some 10 to 100 ms) and put its attempts in the archive."""
        ...


def palm_face_height(hand: HandDescription) -> float:
    """Height of the palm's face over the palm frame's origin [m]."""
    palm = hand.link_names.index(hand.palm_link)
    return float(max(piece.vertices[:, 2].max() for piece in hand.link_collision[palm]))
