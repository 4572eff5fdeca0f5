"""Objects that PyBullet's data package ships, scaled to what a hand can span, seeded.

The package's thousand random parts are unions of convex blocks in no particular unit, and its
household objects have the most various sizes; so each object gets a size of its own.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gpis_grasp_planner.errors import MeshError, RequestError
from gpis_grasp_planner.geometry.catalogue import CatalogueSettings, load_part
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.scene.bullet_world import bullet_data_directory

RANDOM_SET = "PyBullet random"
HOUSEHOLD_SET = "PyBullet household"
LONGEST_SIDE_M = (0.04, 0.12)

# What a hand could be asked to hold, one file each; furniture, robots and terrains are left out.
_HOUSEHOLD: Mapping[str, str] = {
    "bunny": "bunny.obj",
    "concave-box": "toys/concave_box.obj",
    "cone": "racecar/meshes/cone.obj",
    "cube": "cube.obj",
    "cylinder": "toys/cylinder.obj",
    "domino": "domino/domino.obj",
    "duck": "duck.obj",
    "jenga": "jenga/jenga.obj",
    "lego": "lego/lego.obj",
    "mug": "objects/mug.obj",
    "prism": "toys/prism.obj",
    "shape-sorter": "toys/shape_sorter.obj",
    "soccerball": "soccerball.obj",
    "stone": "stone.obj",
    "teddy": "teddy2_VHACD_CHs.obj",
    "torus": "torus/torus_textured.obj",
    "tray": "tray/tray_textured.obj",
    "tray-2": "tray/tray_textured2.obj",
    "tray-4": "tray/tray_textured4.obj",
    "wheel": "racecar/meshes/left_front_wheel.obj",
}
# Their models stretch a unit cube.
_STRETCH = {"jenga": (0.15, 0.05, 0.03)}


@dataclass(frozen=True)
class Refusal:
    """An object whose mesh was refused, and why."""

    object_id: str
    object_set: str
    message: str


def bullet_objects(
    n_random: int, seed: int = 0, settings: CatalogueSettings | None = None
) -> tuple[dict[str, list[Part]], list[Refusal]]:
    """Load random parts and all household objects.

    Parameters
    ----------
    n_random : int
        Random parts: evenly spread over those that are shipped, where the first one is seeded.
    seed : int
        Also of the sizes: the longest side is uniform between 40 and 120 mm. An object's size
        depends on its name and the seed only, not on which others take part.
    settings : CatalogueSettings, optional
        What is done about defects; the limits of size do not apply to the files as they are.

    Returns
    -------
    parts : dict
        By set.
    refused : list of Refusal
        About 0.1 s per object.

    Raises
    ------
    RequestError
        If more parts are asked for than there are.
    """
    settings = replace(settings or CatalogueSettings(), min_extent_m=1e-6, max_extent_m=1000.0)
    root = bullet_data_directory()
    files = _random_files(root, n_random, seed)
    household = {f"bullet-{name}": root / file for name, file in _HOUSEHOLD.items()}
    parts: dict[str, list[Part]] = {RANDOM_SET: [], HOUSEHOLD_SET: []}
    refused: list[Refusal] = []
    for object_set, members in ((RANDOM_SET, files), (HOUSEHOLD_SET, household)):
        for object_id, path in members.items():
            try:
                part = load_part(path, "m", settings)
            except MeshError as error:
                refused.append(Refusal(object_id, object_set, str(error)))
                continue
            stretch = np.array(_STRETCH.get(object_id.removeprefix("bullet-"), (1.0, 1.0, 1.0)))
            side = np.random.default_rng([seed, zlib.crc32(object_id.encode())]).uniform(
                *LONGEST_SIDE_M
            )
            parts[object_set].append(scaled(part, object_id, stretch, float(side)))
    return parts, refused


def scaled(part: Part, object_id: str, stretch: np.ndarray, longest_side_m: float) -> Part:
    """A part stretched along its axes by (3,) factors, then scaled to a longest side [m]."""
    scale = stretch * longest_side_m / float((part.mesh.extent * stretch).max())
    volume = part.volume * float(scale.prod())
    return replace(
        part,
        mesh_id=object_id,
        mesh=TriangleMesh(part.mesh.vertices * scale, part.mesh.faces),
        center_of_mass=part.center_of_mass * scale,
        volume=volume,
        mass=part.mass * volume / part.volume,
        notes=(*part.notes, f"Scaled to a longest side of {1e3 * longest_side_m:.1f} mm."),
    )


def _random_files(root: Path, n: int, seed: int) -> dict[str, Path]:
    files = sorted(root.glob("random_urdfs/*/*.obj"))
    if not 0 <= n <= len(files):
        raise RequestError(
            f"{n} random objects of PyBullet were asked for; it ships {len(files)}. Ask for at "
            "most that many."
        )
    if n == 0:
        return {}
    step = len(files) / n
    first = np.random.default_rng(seed).uniform(0.0, step)
    chosen = [files[min(int(first + i * step), len(files) - 1)] for i in range(n)]
    return {f"bullet-random-{path.stem}": path for path in chosen}
