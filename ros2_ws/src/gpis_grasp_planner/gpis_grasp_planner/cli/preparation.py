"""Compiled code before the clock starts: nobody's time budget pays for numba."""

from __future__ import annotations

from collections.abc import Callable

from gpis_grasp_planner.cli import output

COMPILING = "gpis-grasp: compiling the planner, once after an installation or change (1 min) ..."


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
