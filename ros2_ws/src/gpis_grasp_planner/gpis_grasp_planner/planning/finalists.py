"""From the archive to the answer: exact quality, ranking, and grasps as the caller sees them."""

from __future__ import annotations

import time

import numpy as np

from gpis_grasp_planner.planning.context import PlanningContext
from gpis_grasp_planner.planning.grasp import Grasp
from gpis_grasp_planner.planning.ranking import Candidate
from gpis_grasp_planner.quality.wrench_space import grasp_quality

_SPARE = 1.25


def choose_finalists(
    context: PlanningContext, n_grasps: int, deadline: float | None
) -> tuple[Grasp, ...]:
    """The best distinct grasps, ranked by exact epsilon + lambda volume, best first.

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
    weight = context.settings.hpp.volume_weight
    grasps.sort(key=lambda g: -(g.epsilon + weight * g.volume))
    return tuple(grasps[:n_grasps])


def grasp_of(candidate: Candidate, context: PlanningContext) -> Grasp:
    """A candidate with its exact quality."""
    attempts, i = candidate.attempts, candidate.index
    contacts = attempts.contacts(i)
    scene = context.settings.scene
    quality = grasp_quality(
        contacts, context.part.center_of_mass, context.max_radius, scene.cone_edges
    )
    T_object_palm = attempts.T_object_palm[i].copy()
    pregrasp = np.zeros(context.hand.n_joints)
    if attempts.start_joints is not None:
        pregrasp[:] = attempts.start_joints[i]
    else:
        for finger in context.hand.fingers:
            if finger.spread_joint >= 0:
                pregrasp[finger.spread_joint] = attempts.spread[i]
    return Grasp(
        T_object_palm=T_object_palm,
        joints=attempts.joints[i].copy(),
        pregrasp_joints=pregrasp,
        contacts=contacts,
        epsilon=quality.epsilon,
        volume=quality.volume,
        approach_direction=T_object_palm[:3, 2].copy(),
        approach_distance=scene.retreat_m,
    )
