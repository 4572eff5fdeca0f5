"""From an earlier answer to one for the place where the part lies now, without a new search.

The part lies now here, now there. The grasps and the reserve of an answer are held against the
surroundings of the new place; what is clear is ranked as ever.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.funnel import Funnel, Step
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.measured import with_figures
from gpis_grasp_planner.grasp.order import answer_rank, distinct
from gpis_grasp_planner.grasp.reserve import Reserve
from gpis_grasp_planner.plan.answer import Answer, causes_text, found_text
from gpis_grasp_planner.plan.finisher import FinishedGrasp
from gpis_grasp_planner.plan.hold_ranking import HoldRanking
from gpis_grasp_planner.plan.objective import measures_of, objective_of
from gpis_grasp_planner.plan.placed_grasps import GraspPlacing
from gpis_grasp_planner.plan.progress import Monitor, Phase
from gpis_grasp_planner.plan.request import PlanRequest, PlanResult
from gpis_grasp_planner.surroundings.clearance import Clearance
from gpis_grasp_planner.surroundings.place import STAND_IN, Place
from gpis_grasp_planner.surroundings.similarity import same_place

Array = NDArray[np.float64]

_SPARE = 1.25
# Settings that make the figures of grasps, and those of the group of trials that do not.
_OF_FIGURES: dict[str, tuple[str, ...]] = {
    "scene": ("contact_threshold_m", "closing_gap_m", "cone_edges"),
    "hpp": ("volume_weight", "balance_friction_share"),
}
_NOT_OF_TRIALS = {
    "draws", "payload_kg", "noise_m", "noise_deg", "noise_repeats", "lift_m", "shake_m",
    "processes", "trial_limit_s", "budget_share",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class KnownAnswer:
    """An answer from what was known, and whether that is enough.

    Attributes
    ----------
    answer : Answer
    finished : tuple of FinishedGrasp
        Its grasps, for a search that goes on from here.
    same_place : bool
        Whether the earlier plan was made for surroundings like these.
    """

    answer: Answer
    finished: tuple[FinishedGrasp, ...]
    same_place: bool

    def satisfies(self, request: PlanRequest) -> bool:
        """Whether a search is not needed: grasps of this very place, tried as asked."""
        grasps = self.answer.result.grasps
        if not (self.same_place and grasps):
            return False
        return request.verification == "none" or any(g.trials and g.trials.held for g in grasps)


def place_known(
    known: PlanResult,
    part: Part,
    place: Place,
    request: PlanRequest,
    placing: GraspPlacing,
    hold: HoldRanking,
    monitor: Monitor,
) -> KnownAnswer:
    """Choose and rank the grasps of an earlier answer for a place.

    Parameters
    ----------
    known : PlanResult
        Of this part; its place does not matter.
    part : Part
    place : Place
    request : PlanRequest
    placing : GraspPlacing
        Of this place.
    hold : HoldRanking
        Of this place's covariance.
    monitor : Monitor
        After its deadline nothing further is begun; one grasp is always looked at.

    Raises
    ------
    RequestError
        If `known` is of another mesh, hand, friction, mass, centre of mass or objective.
    PoseError
        INVALID_COVARIANCE.

    Notes
    -----
    About 50 ms for 170 kept grasps and a plane, some 4 ms for each pre-grasp to be narrowed, and
    10 to 60 ms for each grasp that comes from the reserve, the first time; with a covariance about
    2 ms more for each grasp and perturbation.
    """
    _check_same(known, part, request, hold)
    known = replace(known, grasps=tuple(map(_without_probability, known.grasps)))
    same = _same_place(known, place, part.max_radius) and _same_wishes(known, request)
    with monitor.phase(Phase.PLACING):
        grasps, clearances, found = (
            _own(known, part, request, placing, hold) if same else None
        ) or _chosen(known, part, request, placing, hold, monitor)
        of = dict(zip(map(_palm, grasps), clearances, strict=True))
        ranked, notes = hold.ranked(grasps, monitor.deadline, monitor)
    blocked = Counter[str](clearance.cause for clearance in found if clearance.cause is not None)
    answered = tuple(ranked[: request.n_grasps])
    code, message = _message(known, answered, found, blocked, placing.constrained, hold.needed)
    result = replace(
        known,
        code=code,
        message=message,
        grasps=answered,
        best_attempt=None if answered else known.best_attempt,
        reserve=_left_over(known, answered),
        request=request,
        notes=known.notes + notes,
        place=place.as_mapping_if_stated(),
        elapsed_s=monitor.elapsed_s,
        funnel=Funnel(
            len(found), {(Step.CLEAR, str(cause)): n for cause, n in blocked.items()}, Step.CLEAR
        ),
        phase_s={str(phase): spent for phase, spent in monitor.phase_s.items()},
    )
    support = placing.around.support
    answer = Answer(
        result,
        tuple(of[_palm(grasp)] for grasp in answered),
        None if support is None else support.normal,
    )
    finished = tuple(
        FinishedGrasp(_without_probability(grasp), of[_palm(grasp)]) for grasp in ranked
    )
    return KnownAnswer(answer, finished, same)


def _check_same(known: PlanResult, part: Part, request: PlanRequest, hold: HoldRanking) -> None:
    """Refuse a plan whose figures are not those of the part, the hand and what is asked for."""
    if known.mesh_hash != part.mesh.content_hash:
        raise RequestError(
            f"The known plan is of mesh {known.mesh_hash[:16]}..., the part has "
            f"{part.mesh.content_hash[:16]}.... Give a plan of this very mesh."
        )
    friction, was = request.friction_for(part.friction), known.friction
    asked = hold.settings.objective
    objective = known.settings.get("objective", {})  # documents of earlier versions lack it
    pairs = (
        ("hand", known.hand, hold.hand.name),
        ("friction", f"{was.finger:g} / {was.palm:g}", f"{friction.finger:g} / {friction.palm:g}"),
        ("mass", f"{known.mass:.6g} kg", f"{part.mass:.6g} kg"),
        ("centre of mass", _in_mm(known.center_of_mass), _in_mm(part.center_of_mass)),
        ("objective", objective.get("name", asked.name), asked.name),
        ("task", objective.get("task", asked.task), asked.task),
    )
    for what, then, now in pairs:
        if then != now:
            raise RequestError(
                f"The known plan was made for the {what} '{then}', now it is '{now}': its figures "
                "do not hold here. Plan anew, without it."
            )
    _check_same_settings(known, hold)


def _check_same_settings(known: PlanResult, hold: HoldRanking) -> None:
    """Refuse a plan whose figures or trials were made by other settings than those of now.

    What documents of earlier versions lack is taken to be the same.
    """
    groups = {**_OF_FIGURES}
    if any(grasp.trials is not None or grasp.hold_estimate is not None for grasp in known.grasps):
        trials = hold.settings.verification.as_dict()
        groups["verification"] = tuple(name for name in trials if name not in _NOT_OF_TRIALS)
    for group, names in groups.items():
        was, present = known.settings.get(group, {}), getattr(hold.settings, group)
        for name in names:
            now = getattr(present, name)
            if (then := was.get(name, now)) != now:
                what = "trials" if group == "verification" else "figures"
                raise RequestError(
                    f"The known plan was made with {group}.{name} {then}, now it is {now}: its "
                    f"{what} do not hold here. Plan anew, without it, or with that setting."
                )


def _in_mm(point: Array) -> str:
    # without a sign of rounding
    return ", ".join(f"{value:.3f}" for value in np.round(1e3 * point, 3) + 0.0) + " mm"


def _own(
    known: PlanResult, part: Part, request: PlanRequest, placing: GraspPlacing, hold: HoldRanking
) -> tuple[list[Grasp], list[Clearance], list[Clearance]] | None:
    """The plan's own grasps, at a place like its own: the answer, if all of them are clear here.

    Not where a covariance ranks more grasps than are answered, nor for more grasps than the plan
    was asked for.
    """
    if hold.needed or request.n_grasps > known.request.n_grasps:
        return None
    placed = placing.as_planned(known.grasps)
    if placed is None:
        return None
    objective = objective_of(known, part)
    pairs = sorted(zip(*placed, strict=True), key=lambda pair: answer_rank(pair[0], objective))[
        : request.n_grasps
    ]
    return [grasp for grasp, _ in pairs], [clearance for _, clearance in pairs], placed[1]


def _chosen(
    known: PlanResult,
    part: Part,
    request: PlanRequest,
    placing: GraspPlacing,
    hold: HoldRanking,
    monitor: Monitor,
) -> tuple[list[Grasp], list[Clearance], list[Clearance]]:
    """The best of the plan and its reserve, their clearances, and those of all looked at."""
    # In free space nothing is blocked: the plan's own grasps are its best.
    spare = _spare(known, request) if placing.constrained else []
    kept = [*known.grasps, *(known.reserve.estimates[i] for i in spare)]
    kept, found = placing.clear(kept)
    chosen = _best(known, part, kept, spare, found, hold.candidates(request.n_grasps), monitor)
    finished = placing.finished([g for g, _ in chosen], [c for _, c in chosen])
    clear = [pair for pair in zip(*finished, strict=True) if pair[1].clear]
    return [grasp for grasp, _ in clear], [clearance for _, clearance in clear], found


def _same_wishes(known: PlanResult, request: PlanRequest) -> bool:
    """Whether the earlier plan was free to use all that this request allows."""
    return _wishes(known.request) == _wishes(request)


def _wishes(request: PlanRequest) -> tuple[object, ...]:
    cone = None if request.approach is None else request.approach.as_mapping()
    return cone, tuple(str(region.as_mapping()) for region in request.forbidden)


def _same_place(known: PlanResult, place: Place, radius: float) -> bool:
    if known.place is None:
        return not place.around() and place.T_world_arm is None
    earlier = Place.from_mapping(known.place, lambda _: STAND_IN)
    return same_place(earlier, place, radius)


def _spare(known: PlanResult, request: PlanRequest) -> list[int]:
    """Grasps of the reserve that may be answered: none that nobody tried where trials count."""
    estimates = known.reserve.estimates
    if request.verification == "require":
        return [i for i, g in enumerate(estimates) if g.trials is not None and g.trials.held]
    taken = {_palm(grasp) for grasp in known.grasps}
    return [i for i, grasp in enumerate(estimates) if _palm(grasp) not in taken]


def _best(
    known: PlanResult,
    part: Part,
    kept: Sequence[Grasp],
    spare: Sequence[int],
    found: Sequence[Clearance],
    n: int,
    monitor: Monitor,
) -> list[tuple[Grasp, Clearance]]:
    """The best clear grasps with exact quality, and their clearances.

    Mutually distinct by the list's rule; where that leaves room, by the reserve's.
    """
    clear = [i for i, clearance in enumerate(found) if clearance.clear]
    if not clear:
        return []
    objective, measures = objective_of(known, part), measures_of(known, part)
    order = np.array(
        sorted(range(len(clear)), key=lambda k: answer_rank(kept[clear[k]], objective))
    )
    T = np.stack([kept[i].T_object_palm for i in clear])
    wanted = int(np.ceil(_SPARE * n))
    first = distinct(T, order, known.torque_scale, wanted)
    rest = [int(i) for i in order if i not in first]
    chosen: list[tuple[Grasp, Clearance]] = []
    for i in [clear[k] for k in (*first, *rest[: wanted - len(first)])]:
        if chosen and (monitor.left_s < 0.0 or monitor.stopped()):
            break
        grasp = kept[i]
        if i >= len(known.grasps):
            exact = known.reserve.exact(spare[i - len(known.grasps)])
            quality = replace(grasp.quality, epsilon=exact.epsilon, volume=exact.volume)
            grasp = with_figures(
                replace(grasp, quality=quality),
                measures,
                known.center_of_mass,
                known.torque_scale,
                known.cone_edges,
            )
        if grasp.feasible:
            chosen.append((grasp, found[i]))
    chosen.sort(key=lambda pair: answer_rank(pair[0], objective))
    return chosen[:n]


def _left_over(known: PlanResult, answered: Sequence[Grasp]) -> Reserve:
    """Everything known that is not answered here: clear or not, it may be elsewhere."""
    if len(answered) == len(known.grasps) and all(
        _palm(a) == _palm(b) for a, b in zip(answered, known.grasps, strict=True)
    ):
        return known.reserve
    taken = {_palm(grasp) for grasp in answered}
    rest = [*known.grasps, *known.reserve.estimates]
    return replace(
        known.reserve, estimates=tuple(g for g in rest if _palm(g) not in taken), _exact={}
    )


def _message(
    known: PlanResult,
    answered: Sequence[Grasp],
    found: Sequence[Clearance],
    blocked: Counter[str],
    placed: bool,
    by_hold: bool,
) -> tuple[ErrorCode, str]:
    if answered:
        return ErrorCode.SUCCESS, found_text(
            known.mesh_id, len(answered), blocked, placed=placed, by_hold=by_hold
        )
    if not blocked:  # nothing was kept, or what was clear has no force closure
        return ErrorCode.NO_FEASIBLE_GRASP, f"No grasp of '{known.mesh_id}' is known here."
    nearest = Counter(c.nearest for c in found if not c.clear).most_common(1)[0][0]
    return ErrorCode.ALL_GRASPS_BLOCKED, (
        f"All {blocked.total()} grasps kept of '{known.mesh_id}' are blocked at this pose "
        f"({causes_text(blocked)}; most often by '{nearest}')."
    )


def _without_probability(grasp: Grasp) -> Grasp:
    """A grasp without what another covariance, or this one before others had it, said of it."""
    return grasp if grasp.hold_probability is None else replace(grasp, hold_probability=None)


def _palm(grasp: Grasp) -> bytes:
    return grasp.T_object_palm.tobytes()
