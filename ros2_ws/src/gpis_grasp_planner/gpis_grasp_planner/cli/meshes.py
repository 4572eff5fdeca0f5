"""List the parts of the catalogue with size, mass and notes."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from gpis_grasp_planner.cli import options, tables
from gpis_grasp_planner.cli.exit_codes import ERROR, SUCCESS
from gpis_grasp_planner.cli.status_line import StatusLine

if TYPE_CHECKING:
    from gpis_grasp_planner.geometry.part import Part

EXAMPLES = """\
examples:
  gpis-grasp meshes
  gpis-grasp meshes --meshes parts --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of 'meshes'."""
    options.add_catalogue(parser)
    options.add_settings(parser)
    parser.add_argument("--json", action="store_true", help="print the list as JSON")


def run(arguments: argparse.Namespace) -> int:
    """Print the table; 1 if a mesh of the catalogue must not be planned on."""
    from gpis_grasp_planner.errors import GraspPlannerError

    _, settings = options.read_settings(arguments.settings, arguments.assignments)
    catalogue = options.catalogue_of(arguments.meshes, settings)
    rows: list[tuple[str, ...]] = []
    facts: list[dict[str, object]] = []
    notes: list[str] = []
    bad = False
    ids = catalogue.ids()
    with StatusLine("reading") as status:  # a point cloud takes seconds
        for number, mesh_id in enumerate(ids, 1):
            status.enter(f"reading {mesh_id} ({number} of {len(ids)})")
            try:
                part = catalogue.load(mesh_id)
            except GraspPlannerError as error:
                bad = True
                rows.append((mesh_id, "", "", "", "", error.code.name))
                notes.append(f"{mesh_id}: {error.code.name}: {error}")
                facts.append({"id": mesh_id, "error": error.code.name, "message": str(error)})
                continue
            rows.append(_row(part))
            notes += [f"{mesh_id}: {note}" for note in part.notes]
            facts.append(_facts(part))
    refused = catalogue.refused()
    notes += [f"{ascii(name)[1:-1]} cannot be asked for: {reason}." for name, reason in refused]
    if arguments.json:
        facts += [
            {"file": name, "error": "INVALID_MESH_ID", "message": why} for name, why in refused
        ]
        print(json.dumps(facts, indent=1))
        return ERROR if bad else SUCCESS
    headings = ("mesh ID", "size [mm]", "mass [kg]", "friction", "faces", "notes")
    cells = zip(*rows, strict=True) if rows else [()] * len(headings)
    tables.print_table(
        [
            tables.Column(heading, column, priority, left=heading in ("mesh ID", "notes"))
            for heading, column, priority in zip(headings, cells, (0, 1, 2, 3, 4, 0), strict=True)
        ]
    )
    if notes:
        print()
    for note in notes:
        tables.print_text(note)
    return ERROR if bad else SUCCESS


def _row(part: Part) -> tuple[str, ...]:
    mu = part.friction
    return (
        part.mesh_id,
        " x ".join(f"{1e3 * side:.0f}" for side in part.mesh.extent),
        f"{part.mass:.3g}",
        "default" if mu is None else f"{mu.finger:g} / {mu.palm:g}",
        str(len(part.mesh.faces)),
        _remark(part),
    )


def _remark(part: Part) -> str:
    noted = "noted" if part.notes else ""
    return noted if part.uncertainty is None else f"cloud, {noted}"


def _facts(part: Part) -> dict[str, object]:
    mu = part.friction
    return {
        "id": part.mesh_id,
        "extent_m": [float(side) for side in part.mesh.extent],
        "mass_kg": part.mass,
        "center_of_mass_m": [float(x) for x in part.center_of_mass],
        "friction": None if mu is None else {"finger": mu.finger, "palm": mu.palm},
        "n_faces": len(part.mesh.faces),
        "mesh_hash": part.mesh.content_hash,
        "surface_deviation_m": None
        if part.uncertainty is None
        else float(part.uncertainty.deviation.mean()),
        "notes": list(part.notes),
    }
