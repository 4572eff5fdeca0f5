"""Draw what a document of grasps holds, and the model behind it."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from gpis_grasp_planner.cli import options
from gpis_grasp_planner.cli.exit_codes import SUCCESS

if TYPE_CHECKING:
    from gpis_grasp_planner.geometry.part import Part
    from gpis_grasp_planner.plan.document import GraspDocument
    from gpis_grasp_planner.surface.implicit_surface import ImplicitSurface

EXAMPLES = """\
examples:
  gpis-grasp render grasps.json --picture best.png
  gpis-grasp render grasps.json --index 2 --picture third.png
  gpis-grasp render grasps.json --sheet --picture sheet.png
  gpis-grasp render grasps.json --lost --picture lost.png
  gpis-grasp render grasps.json --convergence --picture convergence.png
  gpis-grasp render grasps.json --slice --picture slice.png
  gpis-grasp render grasps.json --surface-error --picture error.png
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of 'render'."""
    options.add_document(parser)
    parser.add_argument("--picture", type=Path, required=True, metavar="FILE.png")
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--index", type=int, default=0, metavar="K", help="row of the table; 0, the default: best"
    )
    for name, text in (
        ("sheet", "all grasps, each in a picture of its own"),
        ("lost", "where hands were lost, by cause"),
        ("convergence", "the best epsilon over time"),
        ("slice", "a slice through the implicit surface: mean and deviation"),
        ("surface-error", "how far the implicit surface is from the mesh"),
    ):
        what.add_argument(f"--{name}", action="store_true", help=text)
    parser.add_argument("--json", action="store_true", help="print what was drawn as JSON")


def run(arguments: argparse.Namespace) -> int:
    """Read, check, draw."""
    from gpis_grasp_planner.cli import drawing
    from gpis_grasp_planner.cli.output import check_picture
    from gpis_grasp_planner.plan.document import read_document

    check_picture(arguments.picture)
    document = read_document(arguments.document)
    result, path = document.result, arguments.picture
    drawn: dict[str, object] = {"picture": str(path), "mesh_id": result.mesh_id}
    part = options.part_of_document(document, arguments)
    if arguments.sheet:
        _check_index(arguments.document, 0, len(result.grasps))
        drawing.draw_sheet(path, part, result)
    elif arguments.lost:
        catalogue = options.catalogue_of(arguments.meshes)
        drawing.draw_lost(path, drawing.scene_of(part, result, catalogue))
    elif arguments.convergence:
        from gpis_grasp_planner.view.plots import plot_plan

        plot_plan(result, path)
    elif arguments.slice:
        from gpis_grasp_planner.view.plots import plot_slice

        plot_slice(part, _surface(document, part), path)
    elif arguments.surface_error:
        from gpis_grasp_planner.view.part_pictures import surface_error_picture

        drawing.save(path, surface_error_picture(part, _surface(document, part)))
    else:
        _check_index(arguments.document, arguments.index, len(result.grasps))
        grasp = result.grasps[arguments.index]
        drawing.draw_grasp(path, part, result, grasp)
        drawn |= {"index": arguments.index, "epsilon": grasp.epsilon}
    if arguments.json:
        print(json.dumps(drawn))
    return SUCCESS


def _surface(document: GraspDocument, part: Part) -> ImplicitSurface:
    """The surface by the document's settings."""
    from gpis_grasp_planner.plan.planner import GraspPlanner
    from gpis_grasp_planner.plan.settings import PlannerSettings

    settings = PlannerSettings.from_mapping(document.result.settings)
    return GraspPlanner(settings).prepare(part).atlas.surface


def _check_index(path: Path, index: int, n: int) -> None:
    from gpis_grasp_planner.errors import RequestError

    if 0 <= index < n:
        return
    if n == 0:
        text = "it holds none. Plan with more time."
    elif n == 1:
        text = "it holds one. Give --index 0, or plan with more time."
    else:
        text = f"it holds {n}. Give --index 0 to {n - 1}."
    raise RequestError(f"Grasp {index} is not in {path}: {text}")
