"""Whether a part lies on its support, sinks into it or hovers over it.

A part that a pose estimate or a wrong support plane puts into the table has no grasp there, and a
controller should hear why before the hand moves. Estimates are never exact, so a few millimetres
are told and planned on.
"""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.surroundings.clearance_settings import ClearanceSettings
from gpis_grasp_planner.surroundings.place import Place

_SIGMAS = 3.0


def check_support(part: Part, place: Place, settings: ClearanceSettings) -> tuple[str, ...]:
    """Notes on how a part lies on the support of its place.

    Where the pose has a covariance, three standard deviations along the support's normal are
    allowed beside `settings.support_tolerance_m`.

    Raises
    ------
    RequestError
        INVALID_SCENE where the part reaches farther below the support than that.
    """
    support = place.surroundings.support
    if support is None:
        return ()
    R, t = place.T_world_object[:3, :3], place.T_world_object[:3, 3]
    height = (part.mesh.vertices @ R.T + t - support.point) @ support.normal
    lowest, highest = float(height.min()), float(height.max())
    allowed = settings.support_tolerance_m
    if place.covariance is not None:
        normal = R.T @ support.normal
        allowed += _SIGMAS * float(np.sqrt(normal @ place.covariance[:3, :3] @ normal))
    if lowest < -allowed:
        where = "lies wholly below" if highest <= 0.0 else "reaches into"
        raise RequestError(
            f"The part '{part.mesh_id}' {where} its support '{support.name}': its lowest point is "
            f"{-1e3 * lowest:.1f} mm below the plane; {1e3 * allowed:.1f} mm are allowed "
            "(clearance.support_tolerance_m). Correct the part's pose or the plane, in metres.",
            ErrorCode.INVALID_SCENE,
        )
    if lowest < -settings.margin_m / 3.0:
        return (
            f"The part reaches {-1e3 * lowest:.1f} mm below its support '{support.name}'; planned "
            "all the same.",
        )
    if lowest > settings.support_tolerance_m:
        return (
            f"The part hovers {1e3 * lowest:.1f} mm above its support '{support.name}'. Is the "
            "pose or the plane wrong?",
        )
    return ()
