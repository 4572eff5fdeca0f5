"""The one bounded queue for everything that the planning process is asked to do.

Searches and answers from known plans are made side by side, as the process has a thread for each;
in each of these two lanes the requests have their turn in the order in which they came. What would
make too many wait is told BUSY at once; who asks for a place before the request is looked at, and
gets one, has it.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum

from gpis_grasp_planner.errors import ErrorCode, SystemFault
from gpis_grasp_planner.ros.call import Call


class Lane(Enum):
    """What is done side by side; one order of each at a time."""

    SEARCH = "search"
    KNOWN = "known"


class WorkQueue:
    """Gives requests their turns; may be used from any thread.

    Parameters
    ----------
    size : callable
        How many requests may wait, at the moment of the call.
    """

    def __init__(self, size: Callable[[], int]) -> None:
        self._size = size
        self._changed = threading.Condition()
        self._waiting: dict[Lane, deque[Call]] = {lane: deque() for lane in Lane}
        self._running: dict[Lane, Call | None] = dict.fromkeys(Lane)
        self._reserved: set[Call] = set()

    @property
    def n_running(self) -> int:
        """Requests that are worked on, at most one of each lane."""
        with self._changed:
            return sum(call is not None for call in self._running.values())

    @property
    def n_waiting(self) -> int:
        """Requests that wait for their turn."""
        with self._changed:
            return self._n_waiting()

    def reserve(self, call: Call) -> None:
        """Keep a place for the first turn of a request, which may need none in the end.

        Raises
        ------
        SystemFault
            BUSY where all places are taken.
        """
        with self._changed:
            free = self._running[Lane.SEARCH] is None
            if self._n_taken() >= self._size() + free:
                raise self._busy()
            self._reserved.add(call)

    def release(self, call: Call) -> None:
        """Give a place back that was not used. Idempotent."""
        with self._changed:
            self._reserved.discard(call)

    @contextmanager
    def turn(self, lane: Lane, call: Call) -> Iterator[None]:
        """Wait for the turn of a request; inside, nobody else works in this lane.

        Parameters
        ----------
        lane : Lane
        call : Call
            Admitted by its first turn.

        Raises
        ------
        SystemFault
            BUSY where it would have to wait and too many do.
        PlanningError
            CANCELLED where it is not wanted any more before its turn.
        """
        with call.woken_by(self._wake):
            self._enter(lane, call)
        try:
            yield
        finally:
            with self._changed:
                self._running[lane] = None
                self._changed.notify_all()

    def _enter(self, lane: Lane, call: Call) -> None:
        waiting = self._waiting[lane]
        with self._changed:
            free = self._running[lane] is None and not waiting
            admitted = free or call.admitted or call in self._reserved
            if not admitted and self._n_taken() >= self._size():
                raise self._busy()
            self._reserved.discard(call)
            waiting.append(call)
            try:
                self._changed.wait_for(
                    lambda: call.cancelled or (waiting[0] is call and self._running[lane] is None)
                )
                call.check_wanted()
                call.admitted = True
                self._running[lane] = call
            finally:
                waiting.remove(call)
                self._changed.notify_all()

    def _busy(self) -> SystemFault:
        return SystemFault(
            f"The planning process is busy and {self._n_taken()} requests wait; the limit is "
            f"{self._size()} (parameter queue_size). Call again later.",
            ErrorCode.BUSY,
        )

    def _n_taken(self) -> int:
        return self._n_waiting() + len(self._reserved)

    def _n_waiting(self) -> int:
        return sum(map(len, self._waiting.values()))

    def _wake(self) -> None:
        with self._changed:
            self._changed.notify_all()
