"""Compiled code before the clock starts: nobody's time budget pays for numba."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from gpis_grasp_planner.cli import output

COMPILING = "gpis-grasp: compiling the planner, once after an installation or change (1 min) ..."


def ready_to_plan(planner: str) -> None:
    """Load or compile what `planner` needs; where something must be compiled, say so.

    Raises
    ------
    RequestError
        For an unknown planner.
    """
    from gpis_grasp_planner.search.searches import check_planner

    check_planner(planner)
    with when_compiling(lambda: output.note(COMPILING)):
        from gpis_grasp_planner.plan.warm_up import warm_up

        warm_up([planner])


@contextmanager
def when_compiling(say: Callable[[], None]) -> Iterator[None]:
    """Call `say` once, when numba begins to compile what its cache on disk does not hold.

    A slow machine that loads compiled code compiles nothing, and hears nothing.
    """
    from numba.core import event

    class FirstCompilation(event.Listener):
        said = False

        def on_start(self, event: Any) -> None:  # noqa: ARG002
            if not self.said:
                self.said = True
                say()

        def on_end(self, event: Any) -> None:
            """Nothing to do."""

    with event.install_listener("numba:compile", FirstCompilation()):
        yield
