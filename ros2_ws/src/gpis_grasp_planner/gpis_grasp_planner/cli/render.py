"""Draw one grasp of a document."""

from __future__ import annotations

import argparse
from pathlib import Path

from gpis_grasp_planner.cli import options
from gpis_grasp_planner.cli.exit_codes import SUCCESS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of 'render'."""
    options.add_document(parser)
    parser.add_argument("--index", type=int, default=0, metavar="K", help="0, the default: best")
    parser.add_argument("--picture", type=Path, required=True, metavar="FILE.png")


def run(arguments: argparse.Namespace) -> int:
    """Read, check, draw."""
    from gpis_grasp_planner.cli.drawing import draw_grasp
    from gpis_grasp_planner.cli.output import check_writable
    from gpis_grasp_planner.errors import RequestError
    from gpis_grasp_planner.plan.document import read_document

    check_writable(arguments.picture)
    document = read_document(arguments.document)
    grasps = document.result.grasps
    if not 0 <= arguments.index < len(grasps):
        raise RequestError(
            f"Grasp {arguments.index} is not in {arguments.document}, which holds {len(grasps)}"
            + (f"; give --index 0 to {len(grasps) - 1}." if grasps else ".")
        )
    part = options.part_of_document(document, arguments)
    draw_grasp(arguments.picture, part, document.result, grasps[arguments.index])
    return SUCCESS
