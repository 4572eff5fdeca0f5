"""The planning process: takes orders over a socket pair, one at a time, until that closes."""

from __future__ import annotations

import os
import queue
import sys
import threading
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError
from gpis_grasp_planner.geometry.catalogue import CatalogueSettings, MeshCatalogue
from gpis_grasp_planner.planning.plan import plan_grasps
from gpis_grasp_planner.planning.request import PlanResult, Progress
from gpis_grasp_planner.planning.settings import PlannerSettings
from gpis_grasp_planner.ros.planned import (
    Plan,
    PlanOrder,
    WorkerError,
    WorkerProgress,
    WorkerReady,
)


def make_plan(order: PlanOrder, on_progress: Callable[[Progress], None]) -> Plan:
    """Load the mesh and plan.

    Raises
    ------
    GraspPlannerError
        Of the catalogue or the planner.
    """
    groups = dict(order.settings)
    catalogue_settings = CatalogueSettings.from_mapping(groups.pop("catalogue"))
    catalogue = MeshCatalogue([Path(d) for d in order.mesh_directories], catalogue_settings)
    part = catalogue.load(order.mesh_id)
    settings = PlannerSettings.from_mapping(groups)
    result = plan_grasps(part, order.request, settings, on_progress=on_progress)
    return _light(result, part.notes)


def _light(result: PlanResult, part_notes: tuple[str, ...]) -> Plan:
    return Plan(
        code=result.code,
        message=result.message,
        mesh_id=result.mesh_id,
        mesh_hash=result.mesh_hash,
        grasps=result.grasps,
        best_attempt=result.best_attempt,
        notes=tuple(dict.fromkeys((*part_notes, *result.notes))),
        evaluations=result.evaluations,
        elapsed_s=result.elapsed_s,
    )


def answer(order: PlanOrder, on_progress: Callable[[Progress], None]) -> Plan | WorkerError:
    """Make a plan, or an error that can be sent: whatever happens, there is an answer."""
    try:
        return make_plan(order, on_progress)
    except GraspPlannerError as error:
        return WorkerError(error.code, error.message)
    except MemoryError:
        return WorkerError(
            ErrorCode.INTERNAL,
            "The planning process ran out of memory. Use a mesh with fewer faces, or a machine "
            "with more memory.",
        )
    except Exception as error:
        traceback.print_exc()
        return WorkerError(
            ErrorCode.INTERNAL,
            f"The planner failed unexpectedly ({type(error).__name__}: {error}). The traceback is "
            "in the node's output; please report it.",
        )


def _receive(connection: Connection, orders: queue.SimpleQueue[PlanOrder]) -> None:
    """Take orders; end the process, also in the middle of a plan, when the node is gone."""
    try:
        while True:
            orders.put(connection.recv())
    except (EOFError, OSError):
        os._exit(0)


def main() -> None:
    """Serve orders until the socket pair closes. Argument: the descriptor of this end."""
    connection = Connection(int(sys.argv[1]))
    orders: queue.SimpleQueue[PlanOrder] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(connection, orders), daemon=True).start()
    connection.send(WorkerReady())

    def report(progress: Progress) -> None:
        connection.send(
            WorkerProgress(
                progress.elapsed_s,
                progress.evaluations,
                progress.best_epsilon,
                progress.n_candidates,
            )
        )

    while True:
        connection.send(answer(orders.get(), report))


if __name__ == "__main__":
    main()
