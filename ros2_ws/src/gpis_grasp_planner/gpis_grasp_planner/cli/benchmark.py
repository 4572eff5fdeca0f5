"""Compare planners on many objects and seeds."""

from __future__ import annotations

import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of x"""


def run(arguments: argparse.Namespace) -> int:
    """Not there yet."""
    from gpis_grasp_planner.errors import RequestError

    raise RequestError("The benchmark is not part of this version yet.")
