"""Pictures of grasps that were planned or read."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription, load_hand
from gpis_grasp_planner.plan.request import PlanResult

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gpis_grasp_planner.geometry.catalogue import MeshCatalogue
    from gpis_grasp_planner.geometry.mesh import TriangleMesh
    from gpis_grasp_planner.view.grasp_scene import GraspScene

_SIZE = (1000, 750)


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


def scene_of(part: Part, result: PlanResult, catalogue: MeshCatalogue) -> GraspScene:
    """The result in its place; obstacles' meshes are those of the catalogue or files.

    Raises
    ------
    RequestError
        For an obstacle's mesh that is not there, or another hand of the same name.
    """
    from gpis_grasp_planner.cli.options import find_part
    from gpis_grasp_planner.view.grasp_scene import GraspScene

    def load_mesh(source: str) -> TriangleMesh:
        return find_part(source, None, catalogue)[0].mesh

    return GraspScene.of_result(part, hand_of(result), result, load_mesh)


def draw_grasp(path: Path, part: Part, result: PlanResult, grasp: Grasp) -> None:
    """Write a picture of the hand on the part; a grasp without force closure says so in it."""
    save(path, _picture(part, result, grasp))


def draw_sheet(path: Path, part: Part, result: PlanResult) -> None:
    """Write a picture of all grasps of a result side by side, numbered as in the table."""
    from gpis_grasp_planner.view.picture import GraspView, render_sheet

    hand = hand_of(result)
    views = [
        GraspView(
            part.mesh,
            hand,
            grasp.T_object_palm,
            grasp.joints,
            grasp.contacts,
            f"{number}: epsilon {grasp.epsilon:.4f}",
        )
        for number, grasp in enumerate(result.grasps)
    ]
    render_sheet(views, path=path, columns=4)


def draw_lost(path: Path, scene: GraspScene) -> None:
    """Write a picture of where hands were lost."""
    from gpis_grasp_planner.view.part_pictures import lost_palms_picture

    save(path, lost_palms_picture(scene, caption=scene.part.mesh_id, size=_SIZE))


def draw_explained(path: Path, scene: GraspScene, result: PlanResult) -> None:
    """Write a picture of the best grasp, or attempt, with where hands were lost beside it."""
    import numpy as np

    from gpis_grasp_planner.view.part_pictures import lost_palms_picture

    pictures = [lost_palms_picture(scene, size=_SIZE)]
    if scene.grasps:
        pictures.insert(0, _picture(scene.part, result, scene.grasps[0]))
    save(path, np.hstack(pictures))


def save(path: Path, pixels: NDArray[np.uint8]) -> None:
    """Write a picture (h, w, 3) in the format of the file's suffix."""
    from PIL import Image

    Image.fromarray(pixels).save(path)


def _picture(part: Part, result: PlanResult, grasp: Grasp) -> NDArray[np.uint8]:
    """The grasp with its support and the way of the palm."""
    from gpis_grasp_planner.view.picture import render_grasp

    quality = f"epsilon {grasp.epsilon:.4f}, volume {grasp.volume:.4f}"
    return render_grasp(
        part.mesh,
        hand_of(result),
        grasp.T_object_palm,
        grasp.joints,
        grasp.contacts,
        size=_SIZE,
        caption=f"{result.mesh_id}: {quality if grasp.feasible else 'no force closure'}",
        around=_support(part, result),
        approach=grasp.approach_distance * grasp.approach_direction,
    )


def _support(part: Part, result: PlanResult) -> list[TriangleMesh]:
    """What carries the part, in the part's frame; meshes of obstacles may be elsewhere by now."""
    from gpis_grasp_planner.surroundings.obstacles import Surroundings
    from gpis_grasp_planner.surroundings.place import STAND_IN, Place
    from gpis_grasp_planner.view.grasp_scene import surrounding_meshes

    if result.place is None:
        return []
    place = Place.from_mapping(result.place, lambda _source: STAND_IN)
    carried = Surroundings(support=place.around().support)
    return list(surrounding_meshes(carried, part.mesh.vertices).values())


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
