"""From a plan in the object's frame to the answer for one place: clear grasps, best first.

A plan is made once for a mesh and kept; the part then lies now so, now so. Here the plan's grasps
and its reserve are held against the surroundings of one place, which plans nothing anew.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.order import answer_rank, distinct
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.plan.request import PlanResult
from gpis_grasp_planner.surroundings.clearance import Cause, Clearance, clear_grasps
from gpis_grasp_planner.surroundings.clearance_settings import ClearanceSettings
from gpis_grasp_planner.surroundings.obstacles import Surroundings
from gpis_grasp_planner.surroundings.pregrasp import narrow_pregrasp

Array = NDArray[np.float64]

_SPARE = 1.25
_ON_THE_WAY = (Cause.PREGRASP, Cause.CLOSING, Cause.APPROACH)


@dataclass(frozen=True, eq=False)
class PlacedAnswer:
    """The answer for one place of the part.

    Attributes
    ----------
    result : PlanResult
        The plan with the grasps that are clear here; code ALL_GRASPS_BLOCKED where none is. It
        keeps the plan's reserve.
    clearances : tuple of Clearance
        One per grasp of the result.
    blocked : mapping of Cause to int
        Kept grasps that are blocked here, by cause.
    lift_direction : (3,) array or None
        Unit vector away from the support, in the object's frame; None without support.
    """

    result: PlanResult
    clearances: tuple[Clearance, ...]
    blocked: Mapping[Cause, int]
    lift_direction: Array | None


def place_answer(
    result: PlanResult,
    hand: HandDescription,
    surroundings: Surroundings,
    settings: ClearanceSettings,
    *,
    n_grasps: int | None = None,
    tree: TriangleTree | None = None,
    deadline: float | None = None,
) -> PlacedAnswer:
    """Choose the grasps of a plan that are clear of the surroundings.

    Parameters
    ----------
    result : PlanResult
    hand : HandDescription
    surroundings : Surroundings
        In the object's frame: ``surroundings_world.seen_from(T_world_object)``.
    settings : ClearanceSettings
    n_grasps : int, optional
        At most; as many as the plan's request asked for if not given.
    tree : TriangleTree, optional
        Of the part, needed for a narrow pre-grasp; without it the hand comes open.
    deadline : float, optional
        Time of ``time.monotonic`` after which no further grasp of the reserve gets its exact
        quality.

    Notes
    -----
    About 50 ms for 170 kept grasps and a plane, some 4 ms for each pre-grasp to be narrowed, and
    10 to 60 ms for each grasp that comes from the reserve, the first time.
    """
    lift = None if surroundings.support is None else surroundings.support.normal
    spare = _spare(result)
    kept = [*result.grasps, *(result.reserve.estimates[i] for i in spare)]
    if not kept:
        return PlacedAnswer(result, (), {}, lift)
    if settings.pregrasp == "open":
        tree = None
    found = clear_grasps(hand, kept, surroundings, settings)
    if tree is not None:
        _rescue(kept, found, hand, surroundings, settings, tree)
    clear = [i for i, clearance in enumerate(found) if clearance.clear]
    blocked = Counter(clearance.cause for clearance in found if clearance.cause is not None)
    n = result.request.n_grasps if n_grasps is None else n_grasps
    chosen = _best(result, kept, spare, clear, n, deadline)
    if not chosen:
        return PlacedAnswer(_nothing(result, found, blocked), (), blocked, lift)
    grasps = [replace(grasp, lift_direction=lift) for grasp, _ in chosen]
    clearances = [found[i] for _, i in chosen]
    if tree is not None:
        _narrow(grasps, clearances, hand, surroundings, settings, tree)
    causes = f" ({causes_text(blocked)})" if blocked else ""
    message = (
        f"{len(grasps)} grasps of '{result.mesh_id}' clear of the surroundings, best first; "
        f"{blocked.total()} of {len(kept)} kept are blocked{causes}."
    )
    answer = replace(result, grasps=tuple(grasps), code=ErrorCode.SUCCESS, message=message)
    return PlacedAnswer(answer, tuple(clearances), blocked, lift)


def causes_text(blocked: Mapping[Cause, int]) -> str:
    """Counts by cause, such as "palm 3, finger 12"."""
    return ", ".join(f"{cause} {blocked[cause]}" for cause in Cause if blocked.get(cause))


def _spare(result: PlanResult) -> list[int]:
    """Grasps of the reserve that may be answered beside those of the result.

    A verified one may be among the result's already. Where only verified grasps are wanted, none
    may: nobody tried them.
    """
    if result.request.verification == "require":
        return []
    taken = {grasp.T_object_palm.tobytes() for grasp in result.grasps}
    estimates = result.reserve.estimates
    return [i for i, g in enumerate(estimates) if g.T_object_palm.tobytes() not in taken]


def _rescue(
    kept: list[Grasp],
    found: list[Clearance],
    hand: HandDescription,
    surroundings: Surroundings,
    settings: ClearanceSettings,
    tree: TriangleTree,
) -> None:
    """Give grasps that are blocked on the way only a narrower hand, in place."""
    rows = [i for i, clearance in enumerate(found) if clearance.cause in _ON_THE_WAY]
    narrow = narrow_pregrasp(hand, [kept[i] for i in rows], tree, settings.pregrasp_clearance_m)
    for i, grasp, clearance in zip(
        rows, narrow, clear_grasps(hand, narrow, surroundings, settings), strict=True
    ):
        if clearance.clear:
            kept[i], found[i] = grasp, clearance


def _narrow(
    grasps: list[Grasp],
    clearances: list[Clearance],
    hand: HandDescription,
    surroundings: Surroundings,
    settings: ClearanceSettings,
    tree: TriangleTree,
) -> None:
    """Narrow the pre-grasps where that stays clear, in place."""
    narrow = narrow_pregrasp(hand, grasps, tree, settings.pregrasp_clearance_m)
    checked = clear_grasps(hand, narrow, surroundings, settings)
    for i, (grasp, clearance) in enumerate(zip(narrow, checked, strict=True)):
        if clearance.clear:
            grasps[i], clearances[i] = grasp, clearance


def _best(
    result: PlanResult,
    kept: Sequence[Grasp],
    spare: Sequence[int],
    clear: Sequence[int],
    n: int,
    deadline: float | None,
) -> list[tuple[Grasp, int]]:
    """The best clear grasps with exact quality, and their indices among the kept.

    Mutually distinct by the list's rule; where that leaves room, by the reserve's.
    """
    if not clear:
        return []
    weight = float(result.settings.get("hpp", {}).get("volume_weight", 0.0))
    ranks = [answer_rank(kept[i], weight) for i in clear]
    order = np.array(sorted(range(len(clear)), key=ranks.__getitem__))
    T = np.stack([kept[i].T_object_palm for i in clear])
    wanted = int(np.ceil(_SPARE * n))
    first = distinct(T, order, result.torque_scale, wanted)
    rest = [int(i) for i in order if i not in first]
    chosen: list[tuple[Grasp, int]] = []
    for i in [clear[k] for k in (*first, *rest[: wanted - len(first)])]:
        if chosen and deadline is not None and time.monotonic() > deadline:
            break
        grasp = kept[i]
        if i >= len(result.grasps):
            exact = result.reserve.exact(spare[i - len(result.grasps)])
            grasp = replace(grasp, epsilon=exact.epsilon, volume=exact.volume)
        if grasp.feasible:
            chosen.append((grasp, i))
    chosen.sort(key=lambda pair: answer_rank(pair[0], weight))
    return chosen[:n]


def _nothing(result: PlanResult, found: Sequence[Clearance], blocked: Counter[Cause]) -> PlanResult:
    if not blocked:  # some were clear, and none of those has force closure
        return replace(result, grasps=(), code=ErrorCode.NO_FEASIBLE_GRASP)
    nearest = Counter(c.nearest for c in found if not c.clear).most_common(1)[0][0]
    message = (
        f"All {blocked.total()} grasps kept of '{result.mesh_id}' are blocked at this pose "
        f"({causes_text(blocked)}; most often by '{nearest}'). Plan with the surroundings known, "
        "or move the part or the obstacle."
    )
    return replace(result, grasps=(), code=ErrorCode.ALL_GRASPS_BLOCKED, message=message)
