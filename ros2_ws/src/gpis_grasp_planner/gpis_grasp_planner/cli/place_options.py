"""Options that say where a part lies: table, obstacles, and how well its pose is known."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gpis_grasp_planner.cli.constraint_options import FIELDS

if TYPE_CHECKING:
    from gpis_grasp_planner.geometry.catalogue import MeshCatalogue
    from gpis_grasp_planner.geometry.mesh import TriangleMesh
    from gpis_grasp_planner.geometry.part import Part
    from gpis_grasp_planner.surroundings.place import Place

LOWEST = "lowest"


def add_place(parser: argparse.ArgumentParser) -> None:
    """Add --scene, --support, --covariance, --sigma-mm and --sigma-deg."""
    group = parser.add_argument_group("where the part lies")
    group.add_argument(
        "--scene",
        metavar="FILE",
        type=Path,
        help="support and obstacles as YAML or JSON, with the part's pose among them; "
        "docs/clearance.md has the form",
    )
    group.add_argument(
        "--support",
        metavar="Z",
        help="the part stands on the plane at height Z [m] of its own frame; 'lowest': on its "
        "lowest point",
    )
    group.add_argument(
        "--covariance",
        metavar="C,...",
        help="of the pose, in the part's axes (x, y, z, rotation about x, y, z; m^2, rad^2): 36 "
        "numbers, or the 6 of the diagonal",
    )
    group.add_argument(
        "--sigma-mm", type=float, metavar="S", help="standard deviation of the position, each axis"
    )
    group.add_argument(
        "--sigma-deg", type=float, metavar="S", help="standard deviation of the rotation, each axis"
    )


def place_of(arguments: argparse.Namespace, part: Part, catalogue: MeshCatalogue) -> Place:
    """Build the place that the options describe; false where there is none of them.

    Raises
    ------
    RequestError
        INVALID_SCENE, or for options that contradict each other.
    PoseError
        INVALID_COVARIANCE.
    """
    from gpis_grasp_planner.cli.options import find_part
    from gpis_grasp_planner.surroundings.place import Place

    data = scene_of_file(arguments.scene)
    data = {name: value for name, value in data.items() if name not in FIELDS}
    if arguments.support is not None:
        if "support" in data:
            raise _wrong(f"Both --support and {arguments.scene} give a support. Leave one out.")
        data["support"] = {"point": [0.0, 0.0, _height(arguments.support, part)]}
        if "object" in data:
            raise _wrong(
                f"--support is in the part's own frame, and {arguments.scene} puts the part "
                "elsewhere. Give the support in the file."
            )
    covariance = _covariance(arguments)
    if covariance is not None:
        if "covariance" in data:
            raise _wrong(f"Both options and {arguments.scene} give a covariance. Leave one out.")
        data["covariance"] = covariance

    def load_mesh(source: str) -> TriangleMesh:
        return find_part(source, None, catalogue)[0].mesh

    return Place.from_mapping(data, load_mesh)


def scene_of_file(file: Path | None) -> dict[str, Any]:
    """What a file of --scene says; empty without one.

    Raises
    ------
    RequestError
        INVALID_SCENE.
    """
    from gpis_grasp_planner.surroundings.text import parse_scene

    if file is None:
        return {}
    try:
        content = parse_scene(file.read_text(encoding="utf-8"), str(file))
    except UnicodeDecodeError:
        raise _wrong(f"{file} is no text in UTF-8. Name a YAML or JSON file.") from None
    if not isinstance(content, Mapping):
        raise _wrong(f"{file} must hold 'support', 'obstacles' or 'object'. See docs/clearance.md.")
    return dict(content)


def _height(text: str, part: Part) -> float:
    if text == LOWEST:
        return float(part.mesh.bounds[0][2])
    try:
        return float(text)
    except ValueError:
        raise _wrong(
            f"--support is '{text}'; give a height in metres of the part's own frame, or "
            f"'{LOWEST}'."
        ) from None


def _covariance(arguments: argparse.Namespace) -> list[float] | None:
    sigmas = (arguments.sigma_mm, arguments.sigma_deg)
    if arguments.covariance is not None:
        if any(sigma is not None for sigma in sigmas):
            raise _wrong("Give either --covariance or --sigma-mm and --sigma-deg.")
        words = arguments.covariance.replace(",", " ").split()
        try:
            return [float(word) for word in words]
        except ValueError:
            raise _wrong(f"--covariance is '{arguments.covariance}'; give numbers.") from None
    if all(sigma is None for sigma in sigmas):
        return None
    import math

    from gpis_grasp_planner.errors import ErrorCode, PoseError

    for sigma, name in zip(sigmas, ("--sigma-mm", "--sigma-deg"), strict=True):
        if sigma is not None and not (math.isfinite(sigma) and sigma >= 0.0):
            raise PoseError(
                f"{name} is {sigma}; give a standard deviation that is not negative.",
                ErrorCode.INVALID_COVARIANCE,
            )
    shift, turn = (1e-3 * (sigmas[0] or 0.0), math.radians(sigmas[1] or 0.0))
    return [shift**2] * 3 + [turn**2] * 3


def _wrong(message: str) -> Exception:
    from gpis_grasp_planner.errors import ErrorCode, RequestError

    return RequestError(message, ErrorCode.INVALID_SCENE)
