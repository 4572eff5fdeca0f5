"""List the parts of the catalogue with size, mass and notes."""

from __future__ import annotations

import argparse

from gpis_grasp_planner.cli import options, tables
from gpis_grasp_planner.cli.exit_codes import ERROR, SUCCESS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of 'meshes'."""
    options.add_catalogue(parser)
    options.add_settings(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print the table; 1 if a mesh of the catalogue must not be planned on."""
    from gpis_grasp_planner.errors import GraspPlannerError

    _, settings = options.read_settings(arguments.settings, arguments.assignments)
    catalogue = options.catalogue_of(arguments.meshes, settings)
    rows: list[tuple[str, ...]] = []
    notes: list[str] = []
    bad = False
    for mesh_id in catalogue.ids():
        try:
            part = catalogue.load(mesh_id)
        except GraspPlannerError as error:
            bad = True
            rows.append((mesh_id, "", "", "", "", error.code.name))
            notes.append(f"{mesh_id}: {error.code.name}: {error}")
            continue
        mu = part.friction
        rows.append(
            (
                mesh_id,
                " x ".join(f"{1e3 * side:.0f}" for side in part.mesh.extent),
                f"{part.mass:.3f}",
                "default" if mu is None else f"{mu.finger:g} / {mu.palm:g}",
                str(len(part.mesh.faces)),
                "noted" if part.notes else "",
            )
        )
        notes += [f"{mesh_id}: {note}" for note in part.notes]
    for name, reason in catalogue.refused():
        notes.append(f"{ascii(name)[1:-1]} cannot be asked for: {reason}.")
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
