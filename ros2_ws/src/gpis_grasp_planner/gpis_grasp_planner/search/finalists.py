"""From the archive to the answer: exact quality, ranking, and grasps as the caller sees them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.measured import with_figures
from gpis_grasp_planner.grasp.open_hand import pregrasp_of
from gpis_grasp_planner.grasp.order import DISTINCT, answer_rank
from gpis_grasp_planner.grasp.reserve import Reserve
from gpis_grasp_planner.quality.figures import Quality
from gpis_grasp_planner.quality.wrench_space import grasp_quality
from gpis_grasp_planner.search.archive import Candidate
from gpis_grasp_planner.search.context import PlanningContext

Array = NDArray[np.float64]

RESERVE = 150
_SPARE = 1.25
_RESERVE_APART = 0.5 * DISTINCT


def choose_finalists(
    context: PlanningContext, n_grasps: int, deadline: float | None
) -> tuple[Grasp, ...]:
    """The best distinct grasps, ranked by the objective of their exact figures, best first.

    A few more than asked for are computed exactly, since the search's epsilon is an upper bound.
    Some 10 to 60 ms each.

    Parameters
    ----------
    context : PlanningContext
    n_grasps : int
    deadline : float or None
        Time of ``time.monotonic`` at which no further hull is begun; the first is always
        computed.
    """
    grasps: list[Grasp] = []
    for candidate in context.archive.best(int(np.ceil(_SPARE * n_grasps))):
        if grasps and deadline is not None and time.monotonic() > deadline:
            break
        grasp = grasp_of(candidate, context)
        if grasp.feasible:
            grasps.append(grasp)
    grasps.sort(key=lambda grasp: answer_rank(grasp, context.objective))
    return tuple(grasps[:n_grasps])


def choose_reserve(
    context: PlanningContext,
    chosen: Sequence[Grasp],
    left_out: Sequence[Grasp] = (),
    n: int = RESERVE,
) -> Reserve:
    """What is kept beside an answer: grasps that were finished, then the search's estimates.

    Of those up to `n`, by a smaller distance rule. What lies at the palm poses of the chosen, or
    twice, is left out. Some 10 to 50 ms.
    """
    answered = {grasp.T_object_palm.tobytes() for grasp in chosen}
    rest = [g for g in left_out if g.T_object_palm.tobytes() not in answered]
    taken = answered | {grasp.T_object_palm.tobytes() for grasp in rest}
    further = [
        _grasp(candidate, context, candidate.attempts.quality(candidate.index))
        for candidate in context.archive.best(n + len(taken), _RESERVE_APART)
        if candidate.T_object_palm.tobytes() not in taken
    ]
    return Reserve(
        (*rest, *further[:n]),
        context.part.center_of_mass,
        context.max_radius,
        context.settings.scene.cone_edges,
    )


def grasp_of(candidate: Candidate, context: PlanningContext) -> Grasp:
    """A candidate with its exact quality, and the figures that are to be reported."""
    part, scene = context.part, context.settings.scene
    estimate = candidate.attempts.quality(candidate.index)
    exact = grasp_quality(
        candidate.attempts.contacts(candidate.index),
        part.center_of_mass,
        context.max_radius,
        scene.cone_edges,
    )
    quality = replace(estimate, epsilon=exact.epsilon, volume=exact.volume)
    grasp = _grasp(candidate, context, quality)
    return with_figures(
        grasp, context.reported, part.center_of_mass, context.max_radius, scene.cone_edges
    )


def _grasp(candidate: Candidate, context: PlanningContext, quality: Quality) -> Grasp:
    attempts, i = candidate.attempts, candidate.index
    T_object_palm = attempts.T_object_palm[i].copy()
    return Grasp(
        T_object_palm=T_object_palm,
        joints=attempts.joints[i].copy(),
        pregrasp_joints=pregrasp_of(attempts, np.array([i]), context.hand)[0],
        contacts=attempts.contacts(i),
        quality=quality,
        approach_direction=T_object_palm[:3, 2].copy(),
        approach_distance=context.settings.scene.retreat_m,
    )
