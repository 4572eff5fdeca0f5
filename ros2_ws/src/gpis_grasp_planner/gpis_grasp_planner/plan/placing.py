"""A plan for one place: clear of its surroundings, ranked under the pose's uncertainty.

The node and the command line both go through here. :func:`place_result` takes a plan that exists,
:func:`plan_around` searches anew with the surroundings known, and :func:`plan_at` does the one and,
where that leaves nothing, the other.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.order import answer_rank
from gpis_grasp_planner.plan.placed_answer import PlacedAnswer, causes_text, place_answer
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest, PlanResult, Progress
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.surroundings.clearance import Clearance
from gpis_grasp_planner.surroundings.hold_probability import rank_under_uncertainty
from gpis_grasp_planner.surroundings.place import Place


def place_result(
    planner: GraspPlanner,
    part: Part,
    result: PlanResult,
    place: Place,
    *,
    n_grasps: int | None = None,
    deadline: float | None = None,
) -> PlacedAnswer:
    """Choose and rank the grasps of a plan for one place of the part.

    Parameters
    ----------
    planner : GraspPlanner
        Its settings `clearance` and `uncertainty` hold; what it prepared for the part is used.
    part : Part
    result : PlanResult
        Of this part, made without surroundings or with these.
    place : Place
    n_grasps : int, optional
        At most; as many as the plan's request asked for if not given.
    deadline : float, optional
        Time of ``time.monotonic`` after which nothing further is begun; one grasp is always
        looked at.

    Returns
    -------
    PlacedAnswer
        Its result has the code SUCCESS, ALL_GRASPS_BLOCKED, or that of a plan without grasps.

    Raises
    ------
    PoseError
        INVALID_COVARIANCE.

    Notes
    -----
    With surroundings as `plan.placed_answer.place_answer`, some 0.1 s; with a covariance about 1 ms
    more for each grasp and perturbation (default 20 times 64).
    """
    n = result.request.n_grasps if n_grasps is None else n_grasps
    settings = planner.settings
    covariance = None if settings.uncertainty.method == "none" else place.covariance
    wanted = n if covariance is None else max(n, settings.uncertainty.candidates)
    if place.surroundings:
        answer = place_answer(
            result,
            planner.hand,
            place.around(),
            settings.clearance,
            n_grasps=wanted,
            tree=planner.prepare(part).tree,
            deadline=deadline,
        )
    else:
        few = replace(result, grasps=result.grasps[:wanted])
        answer = PlacedAnswer(few, (Clearance(np.inf),) * len(few.grasps), {}, None)
    message = answer.result.message
    if covariance is not None and answer.result.grasps:
        answer = _ranked_to_hold(planner, part, answer, covariance, deadline)
        message = _message(answer, n)
    chosen = replace(
        answer.result,
        message=message,
        grasps=answer.result.grasps[:n],
        place=place.as_mapping(),
    )
    return replace(answer, result=chosen, clearances=answer.clearances[:n])


def plan_around(
    planner: GraspPlanner,
    part: Part,
    request: PlanRequest,
    place: Place,
    blocked: str = "",
    on_progress: Callable[[Progress], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> PlacedAnswer:
    """Plan with the surroundings known, for this place alone.

    Parameters
    ----------
    planner, part, request, place
    blocked : str
        What blocked the grasps of the plan in free space (`answer.causes_text`), to be told again.
    on_progress, should_stop : callable, optional
        As of `GraspPlanner.plan`.

    Returns
    -------
    PlacedAnswer
        Code ALL_GRASPS_BLOCKED where this search finds nothing either.
    """
    known = replace(request, surroundings=place.around())
    result = planner.plan(part, known, on_progress, should_stop, place)
    # The search is over; what is left to do is short, and an answer without it would be none.
    answer = place_result(planner, part, result, place)
    before = f" ({blocked})" if blocked else ""
    if answer.result.grasps:
        note = (
            f"All grasps kept of the plan in free space were blocked here{before}; these were "
            "planned with the surroundings known."
        )
        notes = (*answer.result.notes, note)
        return replace(answer, result=replace(answer.result, notes=notes))
    if result.code == ErrorCode.CANCELLED:
        return answer
    message = (
        f"Every grasp kept of '{part.mesh_id}' is blocked at this pose{before}, and a search that "
        f"knew the surroundings found none in {result.evaluations} attempts. Move the part or the "
        "obstacle, give more time, or a smaller clearance.margin_m."
    )
    return replace(
        answer,
        result=replace(answer.result, code=ErrorCode.ALL_GRASPS_BLOCKED, message=message),
    )


def plan_at(
    planner: GraspPlanner,
    part: Part,
    request: PlanRequest,
    place: Place,
    on_progress: Callable[[Progress], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> tuple[PlanResult, PlacedAnswer]:
    """Plan in free space, then for the place; search once more where all grasps are blocked.

    Returns
    -------
    result : PlanResult
        The plan in free space, good for other places.
    answer : PlacedAnswer
    """
    start = time.monotonic()
    result = planner.plan(part, request, on_progress, should_stop, place)
    if not place:
        answer = PlacedAnswer(result, (Clearance(np.inf),) * len(result.grasps), {}, None)
        return result, answer
    answer = place_result(planner, part, result, place)
    if answer.result.code == ErrorCode.ALL_GRASPS_BLOCKED:
        again = request.again(time.monotonic() - start)
        causes = causes_text(answer.blocked)
        answer = plan_around(planner, part, again, place, causes, on_progress, should_stop)
    return result, answer


def _ranked_to_hold(
    planner: GraspPlanner,
    part: Part,
    answer: PlacedAnswer,
    covariance: NDArray[np.float64],
    deadline: float | None,
) -> PlacedAnswer:
    """The grasps with their hold probability, in the order of `answer_rank`."""
    result, settings = answer.result, planner.settings
    prepared = planner.prepare(part)
    evaluator = CompiledEvaluator(
        planner.hand, part, result.friction, settings.scene, prepared.field, prepared.tree
    )
    grasps: list[Grasp] = []
    for grasp in result.grasps:
        if grasps and deadline is not None and time.monotonic() > deadline:
            break
        # One at a time for the deadline's sake; the same seed gives all the same perturbations.
        _, [estimate] = rank_under_uncertainty(
            evaluator,
            planner.hand,
            [grasp],
            covariance,
            settings.uncertainty,
            np.random.default_rng(result.request.seed),
        )
        grasps.append(replace(grasp, hold_probability=estimate.probability))
    tried = len(grasps)
    grasps += result.grasps[tried:]
    weight = settings.hpp.volume_weight
    order = sorted(range(len(grasps)), key=lambda i: answer_rank(grasps[i], weight))
    notes = result.notes
    if tried < len(grasps):
        notes += (
            f"The time budget ended after the hold probability of {tried} of {len(grasps)} grasps.",
        )
    return replace(
        answer,
        result=replace(result, grasps=tuple(grasps[i] for i in order), notes=notes),
        clearances=tuple(answer.clearances[i] for i in order),
    )


def _message(answer: PlacedAnswer, n: int) -> str:
    tried = len(answer.result.grasps)
    blocked = f" Blocked here: {causes_text(answer.blocked)}." if answer.blocked else ""
    return (
        f"{min(n, tried)} grasps of '{answer.result.mesh_id}' out of {tried}, ranked by the "
        f"probability to hold under the pose's covariance.{blocked}"
    )
