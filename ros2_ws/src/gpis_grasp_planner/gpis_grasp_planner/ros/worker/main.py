"""The planning process: takes orders over a socket pair until that closes.

It makes plans one at a time on its main thread, and places plans that exist on another: the
compiled code leaves Python's lock to others, so that these answers come while a plan is made.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import queue
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from gpis_grasp_planner.plan.progress import Progress
from gpis_grasp_planner.plan.warm_up import load_compiled, make_ready
from gpis_grasp_planner.ros.worker.messages import (
    CancelOrder,
    MeshFacts,
    Plan,
    PlanOrder,
    WorkerAccepted,
    WorkerAlive,
    WorkerProgress,
    WorkerReady,
)
from gpis_grasp_planner.ros.worker.order_handler import OrderHandler, answer_of

WARM_UP_PLANNER = "hpp"
ALIVE_PERIOD_S = 1.0
_PR_SET_PDEATHSIG = 1


class OrderInbox:
    """The worker's end of the socket pair; orders wait here in a queue of each kind."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._sending = threading.Lock()
        self._unwanted: dict[int, threading.Event] = {}
        self.plans: queue.SimpleQueue[tuple[int, Any]] = queue.SimpleQueue()
        self.places: queue.SimpleQueue[tuple[int, Any]] = queue.SimpleQueue()

    def send(self, number: int, message: object) -> None:
        """Send an answer to order `number`; from any thread."""
        with self._sending:
            self._connection.send((number, message))

    def receive(self) -> None:
        """Take orders; end the process, also in the middle of a plan, when the node is gone."""
        try:
            while True:
                number, message = self._connection.recv()
                if isinstance(message, CancelOrder):
                    if number in self._unwanted:  # else it has been answered
                        self._unwanted[number].set()
                    continue
                self._unwanted[number] = threading.Event()
                kind = self.plans if isinstance(message, PlanOrder) else self.places
                kind.put((number, message))
        except (EOFError, OSError):
            os._exit(0)

    def say_alive(self) -> None:
        """Say every second that this process is not stopped."""
        with contextlib.suppress(OSError):  # the node is gone, which ends this process elsewhere
            while True:
                self.send(0, WorkerAlive())
                time.sleep(ALIVE_PERIOD_S)

    def serve(
        self,
        orders: queue.SimpleQueue[tuple[int, Any]],
        carry_out: Callable[..., Plan | MeshFacts],
        afterwards: Callable[[], None] = lambda: None,
    ) -> None:
        """Carry out orders of a queue, one after the other, for ever.

        `afterwards` is called when an answer has been sent.
        """
        while True:
            number, order = orders.get()
            self.send(number, WorkerAccepted())

            def report(progress: Progress, number: int = number) -> None:
                self.send(number, WorkerProgress(progress))

            unwanted = self._unwanted[number]
            answer = answer_of(carry_out, order, report, unwanted.is_set)
            del self._unwanted[number]
            self.send(number, answer)
            afterwards()
            if isinstance(order, PlanOrder):
                _give_memory_back()


def _warm_up() -> None:
    """Load the compiled code before an order's clock runs; compiling it takes a minute."""
    try:
        if not make_ready(WARM_UP_PLANNER):
            load_compiled()
    except Exception:
        # An order will fail in the same way, and be answered with the reason.
        traceback.print_exc()


def _give_memory_back() -> None:
    """Return freed memory to the system: 30 MB after a plan (glibc keeps it otherwise)."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def end_with_parent(parent: int) -> None:
    """Let the system end this process when its parent is gone, also where it is stopped then.

    Linux alone; elsewhere the closing of the socket pair ends a process that runs.
    """
    prctl = getattr(ctypes.CDLL(None), "prctl", None)
    if prctl is not None:
        prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it went before that was asked for
        os._exit(0)


def main() -> None:
    """Serve orders until the socket pair closes.

    Arguments: the descriptor of this end, the process ID of the node, the nice value over its own.
    """
    os.nice(int(sys.argv[3]))
    end_with_parent(int(sys.argv[2]))
    inbox, handler = OrderInbox(Connection(int(sys.argv[1]))), OrderHandler()
    threading.Thread(target=inbox.receive, daemon=True).start()
    threading.Thread(target=inbox.say_alive, daemon=True).start()
    _warm_up()
    _give_memory_back()
    threading.Thread(
        target=inbox.serve, args=(inbox.places, handler.from_known), daemon=True
    ).start()
    inbox.send(0, WorkerReady())
    inbox.serve(inbox.plans, handler.make_plan, handler.note_uses)


if __name__ == "__main__":
    main()
