"""What the hand cannot do, told at once by a bound instead of after a search that finds nothing.

The bounds are one-sided (`grasp.force_closure_bound`): what they refuse has no grasp; what
has none need not be refused. A part whose mass is known and more than the payload is refused for
that alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.grasp.force_closure_bound import (
    has_no_force_closure,
    is_one_sided,
    is_only_pressed_down,
)
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.reach import open_span, reach_radius
from gpis_grasp_planner.plan.progress import Monitor
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.surroundings.place import Place

_LONGEST_S = 1.5
_BUDGET_SHARE = 0.2


@dataclass(frozen=True)
class HandLimit:
    """Why there can be no grasp: a code and a message with value, limit and next step."""

    code: ErrorCode
    message: str


def limit_of(
    part: Part,
    hand: HandDescription,
    friction: Friction,
    place: Place,
    settings: PlannerSettings,
    monitor: Monitor,
) -> HandLimit | None:
    """Return what the hand cannot do about this part at this place; None where nothing is known.

    Parameters
    ----------
    part : Part
    hand : HandDescription
    friction : Friction
    place : Place
    settings : PlannerSettings
    monitor : Monitor
        A fifth of its budget, and 1.5 s, is the most that is spent.

    Notes
    -----
    Some milliseconds for parts of the hand's size, up to 1.5 s for larger ones; the hand's reach
    takes 0.4 s the first time that it is asked for.
    """
    if (heavy := _over_payload(part, settings)) is not None:
        return heavy
    faces, lowest = _reachable(part, place, settings)
    support = place.around().support
    if not len(faces):
        assert support is not None
        height = float((_heights(part, place)).max())
        return HandLimit(
            ErrorCode.ALL_GRASPS_BLOCKED,
            f"'{part.mesh_id}' lies flat: it rises {1e3 * height:.1f} mm above "
            f"'{support.name}', and the hand can touch only what is higher than "
            f"{1e3 * lowest:.1f} mm (from clearance.margin_m). Raise the part, let "
            "its edge stand over, or give a smaller margin.",
        )
    mu = max(friction.finger, friction.palm)
    if support is not None and (low := _too_low(part, place, mu, settings)) is not None:
        return low
    corners = part.mesh.triangles[faces].reshape(-1, 3)
    extent = float(np.linalg.norm(corners.max(axis=0) - corners.min(axis=0)))
    if extent <= open_span(hand) and not is_one_sided(part.mesh, faces, mu):
        return None
    if not part.watertight:
        return None  # both sides of an open surface may be touched
    end = monitor.now() + min(_LONGEST_S, _BUDGET_SHARE * monitor.time_budget_s)
    radius = reach_radius(hand) + settings.scene.contact_threshold_m

    def late() -> bool:
        return monitor.now() > end or monitor.stopped()

    if not has_no_force_closure(part.mesh, faces, radius, mu, late):
        return None
    sides = ", ".join(f"{1e3 * side:.0f}" for side in part.mesh.extent)
    what = (
        f"No grasp of '{part.mesh_id}' ({sides} mm) can have force closure with this hand: within "
        f"its reach (a ball of {2e3 * radius:.0f} mm) the faces do not oppose each other at a "
        f"friction of {mu:g}"
    )
    if len(faces) < len(part.mesh.faces):
        return HandLimit(
            ErrorCode.ALL_GRASPS_BLOCKED,
            f"{what}, counting those above {1e3 * lowest:.1f} mm over the support. Raise or turn "
            "the part, or give a smaller clearance.margin_m.",
        )
    return HandLimit(
        ErrorCode.NO_FEASIBLE_GRASP,
        f"{what}. Check the mesh's unit and the friction, or use a hand that spans the part.",
    )


def _over_payload(part: Part, settings: PlannerSettings) -> HandLimit | None:
    """A mass that was only assumed refuses nothing: the answer has a note instead."""
    payload = settings.verification.payload_kg
    if part.mass_assumed or part.mass <= payload:
        return None
    return HandLimit(
        ErrorCode.NO_FEASIBLE_GRASP,
        f"'{part.mesh_id}' weighs {part.mass:.3g} kg, more than the hand carries ({payload:g} kg, "
        "verification.payload_kg). Correct its mass or density if it is lighter, or use a "
        "stronger hand and raise the limit.",
    )


def _too_low(part: Part, place: Place, mu: float, settings: PlannerSettings) -> HandLimit | None:
    """Whether all that the hand can touch over the support faces upwards, as of a thin pin."""
    support = place.around().support
    if support is None or not part.watertight:
        return None
    heights, margin = _heights(part, place), settings.clearance.margin_m
    gap = settings.scene.contact_threshold_m
    if not is_only_pressed_down(part.mesh, support.normal, heights, mu, margin, gap):
        return None
    return HandLimit(
        ErrorCode.ALL_GRASPS_BLOCKED,
        f"'{part.mesh_id}' lies too low: it rises {1e3 * heights.max():.1f} mm above "
        f"'{support.name}', and what of it a hand can touch that keeps {1e3 * margin:.1f} mm "
        f"(clearance.margin_m) faces upwards by more than the friction angle of "
        f"{math.degrees(math.atan(mu)):.0f} degrees: it could only be pressed down. Raise the "
        "part, let it stand over an edge, or give a smaller margin.",
    )


def _reachable(
    part: Part, place: Place, settings: PlannerSettings
) -> tuple[NDArray[np.intp], float]:
    """Faces that rise to where a hand may touch them, and that height over the support [m]."""
    # A hand point keeps the margin; what it touches is a contact's gap from it at most.
    lowest = settings.clearance.margin_m - settings.scene.contact_threshold_m
    if place.around().support is None:
        return np.arange(len(part.mesh.faces)), lowest
    top = _heights(part, place)[part.mesh.faces].max(axis=1)
    return np.flatnonzero(top >= lowest), lowest


def _heights(part: Part, place: Place) -> NDArray[np.float64]:
    """Of the vertices above the support [m]; both are seen from the part."""
    support = place.around().support
    assert support is not None
    return np.asarray((part.mesh.vertices - support.point) @ support.normal)
