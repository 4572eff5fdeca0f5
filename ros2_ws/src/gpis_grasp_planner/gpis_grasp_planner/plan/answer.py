"""The answer to a request: grasps for one place of a part, or the reason why there is none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from numpy import float64
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.funnel import Funnel
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.plan.request import PlanResult
from gpis_grasp_planner.surroundings.clearance import Cause, Clearance

# Of the attempts: with more of them blocked, the surroundings are why there is no grasp.
_MOSTLY = 0.5


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer for one place of the part.

    Attributes
    ----------
    result : PlanResult
        With the grasps that are clear here, best first. It may be kept: its grasps and its reserve
        are the beginning of an answer for another place.
    clearances : tuple of Clearance
        One per grasp of the result.
    lift_direction : (3,) array or None
        Unit vector away from the support, in the object's frame; None without support.
    from_known : bool
        Whether an earlier plan was enough, so that nothing was searched.
    """

    result: PlanResult
    clearances: tuple[Clearance, ...]
    lift_direction: NDArray[float64] | None = None
    from_known: bool = False

    @property
    def blocked(self) -> Mapping[str, int]:
        """Grasps with force closure that the surroundings forbid, by cause."""
        return self.result.funnel.blocked


def causes_text(blocked: Mapping[str, int]) -> str:
    """Counts by cause, such as "palm 3, finger 12"."""
    causes = dict.fromkeys([*map(str, Cause), *sorted(map(str, blocked))])
    return ", ".join(f"{cause} {blocked[cause]}" for cause in causes if blocked.get(cause))


def found_text(
    mesh_id: str, n_grasps: int, blocked: Mapping[str, int], *, placed: bool, by_hold: bool
) -> str:
    """The message of an answer with grasps.

    Parameters
    ----------
    mesh_id : str
    n_grasps : int
    blocked : mapping of cause to int
        What the surroundings forbade.
    placed : bool
        Whether there are surroundings.
    by_hold : bool
        Whether the probability to hold had a say in the order.
    """
    clear = " clear of the surroundings" if placed else ""
    order = ", ranked by the probability to hold under the pose's covariance" if by_hold else ""
    causes = causes_text(blocked)
    forbidden = f" Blocked here: {causes}." if causes else ""
    plural = "" if n_grasps == 1 else "s"
    return f"{n_grasps} grasp{plural} of '{mesh_id}'{clear}, best first{order}.{forbidden}"


def nothing_found(
    part: Part,
    hand: HandDescription,
    attempts: int,
    funnel: Funnel,
    n_disagreed: int,
) -> tuple[ErrorCode, str]:
    """Code and message where a search ended without a grasp.

    Parameters
    ----------
    part : Part
    hand : HandDescription
    attempts : int
    funnel : Funnel
    n_disagreed : int
        Grasps that PyBullet's scene did not agree with.
    """
    blocked, screened = funnel.blocked, funnel.screened
    if blocked or sum(screened.values()) > _MOSTLY * attempts:
        what = []
        if screened:
            names = ", ".join(f"'{name}' {n}" for name, n in screened.items())
            what.append(f"{sum(screened.values())} hands were blocked before they closed ({names})")
        if blocked:
            n = sum(blocked.values())
            what.append(f"{n} grasps with force closure after it ({causes_text(blocked)})")
        return (
            ErrorCode.ALL_GRASPS_BLOCKED,
            f"No grasp of '{part.mesh_id}' is clear of its surroundings here: in {attempts} "
            f"attempts {' and '.join(what)}. Move the part or the obstacle, forbid less, give "
            "more time, or a smaller clearance.margin_m.",
        )
    if n_disagreed:
        return (
            ErrorCode.NO_FEASIBLE_GRASP,
            f"PyBullet's scene agreed with none of {n_disagreed} grasps of '{part.mesh_id}' "
            "(limit: scene.confirm_tolerance_m). Give more time, or check the mesh for "
            "overlapping faces.",
        )
    extent = ", ".join(f"{1e3 * side:.0f}" for side in part.mesh.extent)
    return (
        ErrorCode.NO_FEASIBLE_GRASP,
        f"No grasp with force closure of '{part.mesh_id}' ({extent} mm) in {attempts} attempts. "
        "Give more time, check the friction and the mesh's unit, or use a part that the hand "
        f"can span.{_of_pads(hand)}",
    )


def _of_pads(hand: HandDescription) -> str:
    """What may be wrong with a gripper: two points leave the turn about their line free."""
    if len(hand.fingers) > 2 or hand.contact_patches:
        return ""
    return (
        f" The fingers of '{hand.name}' touch at points, and two let a part turn: if their "
        "pads are flat, say so in the hand's YAML file (contact_patches: true)."
    )


def nothing_holds(part: Part, n_grasps: int, why: str) -> str:
    """The message where grasps were found, and none was seen to hold."""
    return (
        f"None of {n_grasps} grasps of '{part.mesh_id}' was seen to hold in physics ({why}). The "
        "best is answered as an attempt. Give more time, or ask without verification."
    )
