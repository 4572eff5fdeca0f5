"""Try the grasps of a document in a physics simulation."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from gpis_grasp_planner.cli import options, tables
from gpis_grasp_planner.cli.exit_codes import NO_ANSWER, SUCCESS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gpis_grasp_planner.grasp.grasp import Grasp
    from gpis_grasp_planner.verification.result import Verification
    from gpis_grasp_planner.verification.settings import VerificationSettings

EXAMPLES = """\
examples:
  gpis-grasp verify grasps.json
  gpis-grasp verify grasps.json --friction 0.6 --mass 0.1 --json verdicts.json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of 'verify'."""
    options.add_document(parser)
    parser.add_argument(
        "--friction", type=float, metavar="MU", help="between hand and part; default: the setting's"
    )
    parser.add_argument(
        "--mass", type=float, metavar="KG", help="of the part; default: the setting's"
    )
    parser.add_argument("--cores", type=int, default=1, metavar="N", help="processes; 1")
    parser.add_argument(
        "--all-directions", action="store_true", help="go on after the first that fails"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="'-' for stdout, alone")
    options.add_settings(parser)


def run(arguments: argparse.Namespace) -> int:
    """Try all grasps; 3 where none holds."""
    from gpis_grasp_planner.cli import output
    from gpis_grasp_planner.cli.drawing import hand_of
    from gpis_grasp_planner.errors import ErrorCode
    from gpis_grasp_planner.plan.document import read_document
    from gpis_grasp_planner.verification.protocol import verify

    output.check_writable(arguments.json)
    settings = _settings(arguments)
    document = read_document(arguments.document)
    part = options.part_of_document(document, arguments)
    grasps = document.result.grasps
    verdicts: Sequence[Verification] = ()
    if grasps:
        verdicts = verify(
            part,
            hand_of(document.result),
            grasps,
            settings,
            processes=arguments.cores,
            stop_at_failure=not arguments.all_directions,
        )
    held = sum(verdict.held for verdict in verdicts)
    to_stdout = arguments.json is not None and str(arguments.json) == "-"
    if arguments.json is not None:
        values = {
            "mesh_id": part.mesh_id,
            "mesh_hash": part.mesh.content_hash,
            "settings": settings.as_dict(),
            "n_held": held,
            "grasps": [{"index": i, **v.as_dict()} for i, v in enumerate(verdicts)],
        }
        text = json.dumps(values, indent=1, allow_nan=False) + "\n"
        if to_stdout:
            print(text, end="")
        else:
            arguments.json.write_text(text, encoding="utf-8")
    if not to_stdout:
        tables.print_table(_columns(grasps, verdicts))
        print()
        tables.print_text(
            f"{held} of {len(grasps)} grasps hold at friction {settings.friction:g} and "
            f"{settings.mass_kg:g} kg; # counts from 0."
        )
    if not held:
        output.note(
            f"gpis-grasp: {ErrorCode.NO_GRASP_HOLDS.name}: None of {len(grasps)} grasps holds. "
            "Plan with more time or grasps, or check friction and mass."
        )
        return NO_ANSWER
    return SUCCESS


def _settings(arguments: argparse.Namespace) -> VerificationSettings:
    from gpis_grasp_planner.errors import RequestError
    from gpis_grasp_planner.verification.settings import VerificationSettings

    if arguments.cores < 1:
        raise RequestError(f"--cores is {arguments.cores}; give at least 1.")
    groups = options.read_groups(arguments.settings, arguments.assignments)
    values = groups.get("verification", {})
    asked = {"friction": arguments.friction, "mass_kg": arguments.mass}
    given = {name: value for name, value in asked.items() if value is not None}
    return VerificationSettings.from_mapping({**values, **given})


def _columns(grasps: Sequence[Grasp], verdicts: Sequence[Verification]) -> list[tables.Column]:
    return [
        tables.Column("#", [str(i) for i in range(len(verdicts))]),
        tables.Column("epsilon", [f"{grasp.epsilon:.4f}" for grasp in grasps], 1),
        tables.Column("held", ["yes" if verdict.held else "no" for verdict in verdicts]),
        tables.Column("slip [mm]", [f"{v.largest_slip_mm:.1f}" for v in verdicts], 2),
        tables.Column("turn [deg]", [f"{v.largest_rotation_deg:.1f}" for v in verdicts], 3),
        tables.Column("penetration [mm]", [f"{1e3 * v.penetration_m:.2f}" for v in verdicts], 4),
        tables.Column("cause", [verdict.cause for verdict in verdicts], left=True),
    ]
