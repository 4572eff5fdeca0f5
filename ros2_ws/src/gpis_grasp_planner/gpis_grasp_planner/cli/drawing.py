"""Pictures of grasps that were planned or read."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription, load_hand
from gpis_grasp_planner.plan.request import PlanResult


def hand_of(result: PlanResult) -> HandDescription:
    """Load the hand of a result.

    Raises
    ------
    RequestError
        INVALID_DOCUMENT if its joints or links are not those of the hand of that name.
    """
    hand = load_hand(result.hand)
    if hand.joint_names != result.joint_names or hand.link_names != result.link_names:
        raise RequestError(
            f"The document's joints and links are not those of the hand '{hand.name}' of this "
            "version. Plan anew.",
            ErrorCode.INVALID_DOCUMENT,
        )
    return hand


def draw_grasp(path: Path, part: Part, result: PlanResult, grasp: Grasp) -> None:
    """Write a picture of the hand on the part; a grasp without force closure says so in it."""
    from gpis_grasp_planner.view.picture import render_grasp

    quality = f"epsilon {grasp.epsilon:.4f}, volume {grasp.volume:.4f}"
    caption = quality if grasp.feasible else "no force closure"
    render_grasp(
        part.mesh,
        hand_of(result),
        grasp.T_object_palm,
        grasp.joints,
        grasp.contacts,
        path=path,
        caption=f"{result.mesh_id}: {caption}",
    )


def best_grasp_drawer(folder: Path) -> Callable[[Part, PlanResult], str]:
    """Return what draws a part's best grasp into a folder, and says the name of the picture.

    A picture that is there is not drawn again (5 s). The name is empty where there is no grasp, or
    the folder cannot be written.
    """

    def draw(part: Part, result: PlanResult) -> str:
        grasp = result.grasps[0] if result.grasps else result.best_attempt
        if grasp is None:
            return ""
        # A name for this very grasp.
        of = hashlib.sha256(result.mesh_hash.encode() + grasp.T_object_palm.round(9).tobytes())
        name = f"{part.mesh_id.replace('/', '__')}-{of.hexdigest()[:12]}.png"
        if (folder / name).exists():
            return name
        try:
            folder.mkdir(parents=True, exist_ok=True)
            draw_grasp(folder / name, part, result, grasp)
        except OSError:
            return ""
        return name

    return draw
