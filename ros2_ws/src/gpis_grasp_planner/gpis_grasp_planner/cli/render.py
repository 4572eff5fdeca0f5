"""Draw one grasp of a document."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from gpis_grasp_planner.cli import options
from gpis_grasp_planner.cli.exit_codes import SUCCESS

EXAMPLES = """\
examples:
  gpis-grasp render grasps.json --picture best.png
  gpis-grasp render grasps.json --index 2 --picture third.png
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of 'render'."""
    options.add_document(parser)
    parser.add_argument(
        "--index", type=int, default=0, metavar="K", help="row of the table; 0, the default: best"
    )
    parser.add_argument("--picture", type=Path, required=True, metavar="FILE.png")
    parser.add_argument("--json", action="store_true", help="print what was drawn as JSON")


def run(arguments: argparse.Namespace) -> int:
    """Read, check, draw."""
    from gpis_grasp_planner.cli.drawing import draw_grasp
    from gpis_grasp_planner.cli.output import check_picture
    from gpis_grasp_planner.errors import RequestError
    from gpis_grasp_planner.plan.document import read_document

    check_picture(arguments.picture)
    document = read_document(arguments.document)
    grasps = document.result.grasps
    if not 0 <= arguments.index < len(grasps):
        raise RequestError(
            f"Grasp {arguments.index} is not in {arguments.document}: {_range(len(grasps))}"
        )
    part = options.part_of_document(document, arguments)
    draw_grasp(arguments.picture, part, document.result, grasps[arguments.index])
    if arguments.json:
        drawn = {
            "picture": str(arguments.picture),
            "mesh_id": document.result.mesh_id,
            "index": arguments.index,
            "epsilon": grasps[arguments.index].epsilon,
        }
        print(json.dumps(drawn))
    return SUCCESS


def _range(n: int) -> str:
    if n == 0:
        return "it holds none. Plan with more time."
    if n == 1:
        return "it holds one. Give --index 0, or plan with more time."
    return f"it holds {n}. Give --index 0 to {n - 1}."
