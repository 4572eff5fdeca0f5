"""List the parts of the catalogue with size, mass and notes."""

from __future__ import annotations

import argparse

from gpis_grasp_planner.cli import options
from gpis_grasp_planner.cli.exit_codes import ERROR, SUCCESS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of 'meshes'."""
    options.add_catalogue(parser)
    options.add_settings(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print the table; 1 if a mesh of the catalogue must not be planned on."""
    from rich import box
    from rich.table import Table

    from gpis_grasp_planner.cli import output
    from gpis_grasp_planner.errors import GraspPlannerError

    _, settings = options.read_settings(arguments.settings, arguments.assignments)
    catalogue = options.catalogue_of(arguments.meshes, settings)
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("mesh ID", "size \\[mm]", "mass \\[kg]", "friction", "faces"):
        table.add_column(heading, no_wrap=True)
    table.add_column("notes", overflow="fold")
    bad = False
    for mesh_id in catalogue.ids():
        try:
            part = catalogue.load(mesh_id)
        except GraspPlannerError as error:
            bad = True
            table.add_row(mesh_id, "", "", "", "", f"{error.code.name}: {error}")
            continue
        mu = part.friction
        table.add_row(
            mesh_id,
            " x ".join(f"{1e3 * side:.0f}" for side in part.mesh.extent),
            f"{part.mass:.3f}",
            "default" if mu is None else f"{mu.finger:g} / {mu.palm:g}",
            str(len(part.mesh.faces)),
            " ".join(part.notes),
        )
    output.console().print(table)
    for name, reason in catalogue.refused():
        output.note(f"{ascii(name)[1:-1]} cannot be asked for: {reason}.")
    return ERROR if bad else SUCCESS
