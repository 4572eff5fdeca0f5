"""The planning process: takes orders over a socket pair until that closes.

It makes plans one at a time on its main thread, and places plans that exist on another: the
compiled code leaves Python's lock to others, so that these answers come while a plan is made.
"""

from __future__ import annotations

import ctypes
import gc
import os
import queue
import sys
import threading
import traceback
from multiprocessing.connection import Connection

from gpis_grasp_planner.plan.progress import Progress
from gpis_grasp_planner.plan.warm_up import warm_up
from gpis_grasp_planner.ros.worker.desk import PlannerDesk, answer_of
from gpis_grasp_planner.ros.worker.messages import (
    PlaceOrder,
    PlanOrder,
    WorkerAccepted,
    WorkerProgress,
    WorkerReady,
)

WARM_UP_PLANNER = "hpp"


class Counter:
    """The worker's end of the socket pair; orders wait here in a queue of each kind."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._sending = threading.Lock()
        self.plans: queue.SimpleQueue[tuple[int, PlanOrder]] = queue.SimpleQueue()
        self.places: queue.SimpleQueue[tuple[int, PlaceOrder]] = queue.SimpleQueue()

    def send(self, number: int, message: object) -> None:
        """Send an answer to order `number`; from any thread."""
        with self._sending:
            self._connection.send((number, message))

    def receive(self) -> None:
        """Take orders; end the process, also in the middle of a plan, when the node is gone."""
        try:
            while True:
                number, order = self._connection.recv()
                if isinstance(order, PlaceOrder):
                    self.send(number, WorkerAccepted())
                    self.places.put((number, order))
                else:
                    self.plans.put((number, order))
        except (EOFError, OSError):
            os._exit(0)


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


def _make_plans(counter: Counter, desk: PlannerDesk) -> None:
    while True:
        number, order = counter.plans.get()
        counter.send(number, WorkerAccepted())

        def report(progress: Progress, number: int = number) -> None:
            counter.send(number, WorkerProgress(progress))

        counter.send(number, answer_of(desk.make_plan, order, report))
        _give_memory_back()


def _place_plans(counter: Counter, desk: PlannerDesk) -> None:
    while True:
        number, order = counter.places.get()
        counter.send(number, answer_of(desk.place, order))


def main() -> None:
    """Serve orders until the socket pair closes. Argument: the descriptor of this end."""
    counter, desk = Counter(Connection(int(sys.argv[1]))), PlannerDesk()
    threading.Thread(target=counter.receive, daemon=True).start()
    _warm_up()
    _give_memory_back()
    threading.Thread(target=_place_plans, args=(counter, desk), daemon=True).start()
    counter.send(0, WorkerReady())
    _make_plans(counter, desk)


if __name__ == "__main__":
    main()
