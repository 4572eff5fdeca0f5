"""The one road to a plan with the store beside it: known plans go in, new ones are kept."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.plan.answer import Answer
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.progress import Monitor
from gpis_grasp_planner.plan.request import PlanRequest, PlanResult
from gpis_grasp_planner.store.conditions import Conditions
from gpis_grasp_planner.store.grasp_store import KEPT_CODES, GraspStore, Kept
from gpis_grasp_planner.store.record import Record
from gpis_grasp_planner.surroundings.place import STAND_IN, Place


@dataclass(frozen=True, eq=False)
class StoredAnswer:
    """An answer, and what the store had to do with it.

    Attributes
    ----------
    answer : Answer
    from_store : bool
        Nothing was searched: the answer is that of an earlier plan.
    kept : bool
        The answer is on the disk, now or from before.
    """

    answer: Answer
    from_store: bool
    kept: bool


def answer_with_store(
    planner: GraspPlanner,
    store: GraspStore | None,
    part: Part,
    request: PlanRequest,
    place: Place | None = None,
    *,
    known: PlanResult | None = None,
    monitor: Monitor | None = None,
    elsewhere: bool = True,
) -> StoredAnswer:
    """Answer by `GraspPlanner.answer`, with what the store knows, and keep what is new.

    Parameters
    ----------
    planner : GraspPlanner
    store : GraspStore or None
    part : Part
    request : PlanRequest
    place : Place, optional
    known : PlanResult, optional
        An earlier answer at hand; the store is not asked, but told.
    monitor : Monitor, optional
    elsewhere : bool
        Whether plans for other places may take part. Without, what is planned depends on the
        request alone.

    Raises
    ------
    GraspPlannerError
        Of the planner; the store raises nothing.
    """
    place = planner.placed(place)
    if store is None:
        answer = planner.answer(part, request, place, known=known, monitor=monitor)
        return StoredAnswer(answer, from_store=False, kept=False)
    conditions = Conditions.of(part, request, planner.settings, planner.hand)
    found = None
    if known is None:
        found = store.find(part, conditions, request, place, elsewhere=elsewhere)
    if found is not None:
        known = found.record.result
    answer = planner.answer(part, request, place, known=known, monitor=monitor)
    if found is not None and answer.from_known:
        result = replace(answer.result, notes=(*answer.result.notes, _note(found, place)))
        return StoredAnswer(replace(answer, result=result), from_store=True, kept=True)
    new = not answer.from_known and answer.result.code in KEPT_CODES
    kept = new and store.put(Record(answer.result, conditions))
    return StoredAnswer(answer, from_store=False, kept=kept)


def _note(found: Kept, place: Place) -> str:
    entry, result = found.entry, found.record.result
    made = time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(entry.made_s))
    text = (
        f"From the grasp store: planned {made} in {result.elapsed_s:.1f} s, "
        f"{result.evaluations} attempts."
    )
    made_for = Place() if result.place is None else Place.from_mapping(result.place, _stand_in)
    then, now = made_for.covariance, place.covariance
    same = then is now if then is None or now is None else np.allclose(then, now)
    if not same:
        text += " Its trials in physics were made for another covariance of the pose."
    return text


def _stand_in(_: str) -> TriangleMesh:
    return STAND_IN
