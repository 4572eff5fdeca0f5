"""Compiled code before the clock starts: nobody's time budget pays for numba."""

from __future__ import annotations

import threading

from gpis_grasp_planner.cli import output

_PATIENCE_S = 6.0


def ready_to_plan(planner: str) -> None:
    """Load or compile what `planner` needs; where that takes long, say why.

    Raises
    ------
    RequestError
        For an unknown planner.
    """
    from gpis_grasp_planner.plan.warm_up import warm_up
    from gpis_grasp_planner.search.searches import check_planner

    check_planner(planner)
    text = "gpis-grasp: compiling the planner, once after an installation or change (1 min) ..."
    timer = threading.Timer(_PATIENCE_S, output.note, [text])
    timer.daemon = True
    timer.start()
    try:
        warm_up([planner])
    finally:
        timer.cancel()
