"""Make the shipped meshes: ``python -m gpis_grasp_benchmark.parts.generate [DIRECTORY]``.

Each part becomes a binary STL in millimetres and a YAML file with unit and material.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_benchmark.parts import gearbox, household
from gpis_grasp_benchmark.parts.solids import Solid, finished
from gpis_grasp_planner.geometry.catalogue import default_catalogue_directory

MESH_DIRECTORY = default_catalogue_directory()
STL_HEADER = b"gpis_grasp_planner part, millimetres"
STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


@dataclass(frozen=True)
class Recipe:
    """How one part is made: its solid, what it is made of, and its longest edge [mm].

    Name and description are those of the function where they are not given.
    """

    build: Callable[[], Solid]
    material: str
    max_edge_mm: float
    given_name: str = ""
    given_description: str = ""
    finish: Callable[[Solid, float], tuple[NDArray[np.float64], NDArray[np.int64]]] = finished

    @property
    def name(self) -> str:
        """The part's ID: the name of its function."""
        return self.given_name or self.build.__name__

    @property
    def description(self) -> str:
        """What the part is: the first line of its function's docstring."""
        return self.given_description or (self.build.__doc__ or "").splitlines()[0]


RECIPES: tuple[Recipe, ...] = (
    Recipe(household.mug, "ceramic", 14.0),
    Recipe(household.flask, "glass", 14.0),
    Recipe(household.phone, "abs", 12.0),
    Recipe(household.sphere, "plastic", 14.0),
    Recipe(household.bishop, "wood", 14.0),
    Recipe(gearbox.spur_gear, "steel", 14.0),
    Recipe(gearbox.stepped_shaft, "steel", 14.0),
    Recipe(gearbox.flange, "steel", 14.0),
    Recipe(gearbox.housing, "aluminium", 18.0),
    Recipe(gearbox.planet_carrier, "steel", 14.0),
    Recipe(gearbox.bearing_cover, "cast_iron", 14.0),
    Recipe(gearbox.bracket, "aluminium", 14.0),
    Recipe(gearbox.coupling_hub, "steel", 14.0),
)


def make(recipe: Recipe) -> NDArray[np.float32]:
    """Corner points (m, 3, 3) [mm] of a part, in the precision of its file."""
    vertices, faces = recipe.finish(recipe.build(), recipe.max_edge_mm)
    return vertices.astype(np.float32)[faces]


def binary_stl(triangles: NDArray[np.float32]) -> bytes:
    """A binary STL of triangles (m, 3, 3)."""
    records = np.zeros(len(triangles), dtype=STL_FACE)
    wide = triangles.astype(np.float64)
    normals = np.cross(wide[:, 1] - wide[:, 0], wide[:, 2] - wide[:, 0])
    records["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    records["corners"] = triangles
    count = np.uint32(len(triangles)).astype("<u4").tobytes()
    return STL_HEADER.ljust(80) + count + records.tobytes()


def sidecar_text(recipe: Recipe) -> str:
    """The YAML file beside a part's mesh."""
    return f'description: "{recipe.description}"\nunit: mm\nmaterial: {recipe.material}\n'


def write_all(directory: Path, recipes: Sequence[Recipe]) -> None:
    """Make parts and write its two files."""
    directory.mkdir(parents=True, exist_ok=True)
    for recipe in recipes:
        triangles = make(recipe)
        (directory / f"{recipe.name}.stl").write_bytes(binary_stl(triangles))
        (directory / f"{recipe.name}.yaml").write_text(sidecar_text(recipe), encoding="utf-8")
        sys.stdout.write(f"{recipe.name:16s} {len(triangles):6d} faces\n")


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("directory", nargs="?", type=Path, default=MESH_DIRECTORY)
    write_all(parser.parse_args(arguments).directory, RECIPES)


if __name__ == "__main__":
    main()
