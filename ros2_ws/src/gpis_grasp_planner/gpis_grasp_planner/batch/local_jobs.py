"""The parts of a catalogue in children of this process, several at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from multiprocessing.connection import Connection, wait

from gpis_grasp_planner.batch.catalogue_work import CatalogueWork
from gpis_grasp_planner.batch.outcome import Outcome
from gpis_grasp_planner.batch.part_child import PartChild
from gpis_grasp_planner.errors import GraspPlannerError

_LOOK_S = 0.25


def outcomes_here(
    work: CatalogueWork,
    mesh_ids: Sequence[str],
    jobs: int,
    stopped: Callable[[], bool],
    show: Callable[[Sequence[str]], None],
) -> Iterator[Outcome]:
    """Do all parts with `jobs` children at a time; outcomes as they come.

    Parameters
    ----------
    work : CatalogueWork
    mesh_ids : sequence of str
    jobs : int
        At least 1.
    stopped : callable
        Where it says so, running children are ended and nothing further is begun.
    show : callable
        Called often, with the parts that are being worked on.
    """
    waiting = list(mesh_ids)[::-1]
    running: dict[Connection, tuple[PartChild, str]] = {}
    try:
        while (waiting or running) and not stopped():
            while waiting and len(running) < jobs:
                mesh_id = waiting.pop()
                child = PartChild(partial(work.do, mesh_id), work.planning.limit_s)
                running[child.connection] = (child, mesh_id)
            show([mesh_id for _, mesh_id in running.values()])
            ready = wait(list(running), _LOOK_S)
            for connection, (child, mesh_id) in list(running.items()):
                if connection in ready or child.late:
                    del running[connection]
                    yield _outcome(child, mesh_id)
    finally:
        for child, _ in running.values():
            child.end()


def _outcome(child: PartChild, mesh_id: str) -> Outcome:
    try:
        outcome: Outcome = child.answer()
    except GraspPlannerError as error:
        return Outcome.lost(mesh_id, error.message, child.elapsed_s)
    return outcome
