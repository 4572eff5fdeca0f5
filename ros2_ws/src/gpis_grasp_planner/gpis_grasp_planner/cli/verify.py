"""Try the grasps of a document in a physics simulation."""

from __future__ import annotations

import argparse

from gpis_grasp_planner.cli import options


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of 'verify'."""
    options.add_document(parser)


def run(arguments: argparse.Namespace) -> int:
    """Not there yet."""
    from gpis_grasp_planner.errors import RequestError

    raise RequestError("Verification is not part of this version yet.")
