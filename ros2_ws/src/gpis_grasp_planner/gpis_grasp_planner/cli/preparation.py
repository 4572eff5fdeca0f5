"""Compiled code before the clock starts: nobody's time budget pays for numba."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from gpis_grasp_planner.cli import output

COMPILING = "gpis-grasp: compiling the planner, once after an installation or change (1 min) ..."


class Stopwatch:
    """Seconds that a ``with`` block took."""

    seconds = 0.0


@contextmanager
def timed_reading() -> Iterator[Stopwatch]:
    """Time what is read in a ``with`` block, without the loading of the code that reads.

    That code is loaded first, by reading a tetrahedron: 1 to 2 s in a new process, all of it
    imports and compiled code, which no time budget pays for.
    """
    from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
    from gpis_grasp_planner.geometry.mesh_file import parse_mesh

    corners = ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1))
    faces = ((1, 3, 2), (1, 2, 4), (1, 4, 3), (2, 3, 4))
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a} {b} {c}" for a, b, c in faces]
    parse_mesh("\n".join(lines).encode(), ".obj", "m", "tetrahedron", CatalogueSettings())
    watch, start = Stopwatch(), time.monotonic()
    yield watch
    watch.seconds = time.monotonic() - start


def ready_to_plan(planner: str, say: Callable[[str], None] = output.note) -> None:
    """Compile what `planner` needs where that has not been done on this machine, and say so.

    Raises
    ------
    RequestError
        For an unknown planner.
    """
    from gpis_grasp_planner.compiled import is_ready, when_compiling
    from gpis_grasp_planner.search.searches import check_planner

    check_planner(planner)
    if is_ready(planner):
        return
    with when_compiling(lambda: say(COMPILING)):
        from gpis_grasp_planner.plan.warm_up import warm_up

        warm_up([planner])
