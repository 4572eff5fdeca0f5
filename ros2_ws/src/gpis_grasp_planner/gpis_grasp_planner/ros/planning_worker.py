"""The planning process: takes orders over a socket pair, one at a time, until that closes."""

from __future__ import annotations

import ctypes
import gc
import os
import queue
import sys
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError
from gpis_grasp_planner.geometry.catalogue import CatalogueSettings
from gpis_grasp_planner.planner import GraspPlanner
from gpis_grasp_planner.planning.request import TIME_BUDGET_RANGE_S, PlanResult, Progress
from gpis_grasp_planner.planning.settings import PlannerSettings
from gpis_grasp_planner.ros.part_loading import PartLoader
from gpis_grasp_planner.ros.planned import (
    Plan,
    PlanOrder,
    WorkerAccepted,
    WorkerError,
    WorkerProgress,
    WorkerReady,
)
from gpis_grasp_planner.scene.warm_up import warm_up

WARM_UP_PLANNER = "hpp"


class Planner:
    """Serves orders; what it prepared for a mesh is kept while the settings stay the same."""

    def __init__(self) -> None:
        self._planner = GraspPlanner()
        self._parts = PartLoader()

    def make_plan(self, order: PlanOrder, on_progress: Callable[[Progress], None]) -> Plan:
        """Load the mesh and plan.

        Loading and preparing a mesh counts against the time budget, but at least half of that is
        left to the search: a first call with a short budget must not end before it began.

        Raises
        ------
        GraspPlannerError
            Of the catalogue or the planner.
        """
        start = time.monotonic()
        groups = dict(order.settings)
        catalogue_settings = CatalogueSettings.from_mapping(groups.pop("catalogue"))
        directories = [Path(directory) for directory in order.mesh_directories]
        part = self._parts.load(directories, catalogue_settings, order.mesh_id)
        settings = PlannerSettings.from_mapping(groups)
        if settings != self._planner.settings:
            self._planner = GraspPlanner(settings)
        self._planner.prepare(part)
        budget_s = order.request.time_budget_s
        left_s = max(budget_s - (time.monotonic() - start), 0.5 * budget_s, TIME_BUDGET_RANGE_S[0])
        request = replace(order.request, time_budget_s=left_s)
        result = self._planner.plan(part, request, on_progress)
        return _light(result, elapsed_s=time.monotonic() - start)

    def answer(
        self, order: PlanOrder, on_progress: Callable[[Progress], None]
    ) -> Plan | WorkerError:
        """Make a plan, or an error that can be sent: whatever happens, there is an answer."""
        try:
            return self.make_plan(order, on_progress)
        except GraspPlannerError as error:
            return WorkerError(error.code, error.message)
        except MemoryError:
            return WorkerError(
                ErrorCode.INTERNAL,
                "The planning process ran out of memory. Use a mesh with fewer faces, or a "
                "machine with more memory.",
            )
        except Exception as error:
            traceback.print_exc()
            return WorkerError(
                ErrorCode.INTERNAL,
                f"The planner failed unexpectedly ({type(error).__name__}: {error}). The "
                "traceback is in the node's output; please report it.",
            )


def _light(result: PlanResult, elapsed_s: float) -> Plan:
    return Plan(
        code=result.code,
        message=result.message,
        mesh_id=result.mesh_id,
        mesh_hash=result.mesh_hash,
        grasps=result.grasps,
        best_attempt=result.best_attempt,
        notes=result.notes,
        evaluations=result.evaluations,
        elapsed_s=elapsed_s,
    )


def _warm_up() -> None:
    """Load the compiled code (2 s) before an order's clock runs; cold, it takes a minute."""
    try:
        warm_up([WARM_UP_PLANNER])
    except Exception:
        # An order will fail in the same way, and be answered with the reason.
        traceback.print_exc()


def _give_memory_back() -> None:
    """Return freed memory to the system: 30 MB after a plan (glibc keeps it otherwise)."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


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
    _warm_up()
    _give_memory_back()
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

    planner = Planner()
    while True:
        order = orders.get()
        connection.send(WorkerAccepted())
        connection.send(planner.answer(order, report))
        _give_memory_back()


if __name__ == "__main__":
    main()
