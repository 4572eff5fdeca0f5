"""Owns the planning process: starts it, replaces it where it died, hung or has grown too large."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError, SystemFault
from gpis_grasp_planner.ros.worker.link import WorkerLink

# Imports and warm-up take 4 s, or a minute and more where nothing is compiled yet.
START_LIMIT_S = 300.0
# One that cannot start shall not keep a core busy with attempts.
REVIVAL_PERIOD_S = 10.0


@dataclass(frozen=True)
class WorkLimits:
    """What an order and the process may take.

    Attributes
    ----------
    grace_s : float [s]
        Beyond an order's time budget; then its caller is answered DEADLINE_EXCEEDED.
    preparation_s : float [s]
        For reading and preparing a mesh; these go on when the caller has been answered.
    retries : int
        How often an order is given to the next process where its own died.
    memory_bytes : float
        A process that has grown beyond this is replaced between two orders.
    nice : int
        The process's nice value over the node's.
    """

    grace_s: float
    preparation_s: float
    retries: int = 0
    memory_bytes: float = math.inf
    nice: int = 0


class WorkerSupervisor:
    """The worker process and, while it is replaced, its successor; may be used from any thread.

    Parameters
    ----------
    limits : callable
        The limits at the moment of the call.
    on_event : callable, optional
        Called with one sentence when the process is started, lost, given up or replaced.
    """

    def __init__(
        self,
        limits: Callable[[], WorkLimits],
        on_event: Callable[[str], None] = lambda _text: None,
    ) -> None:
        self.limits = limits
        self.on_event = on_event
        # Its one thread makes all processes, and lives as long as this process; see WorkerLink.
        self._starter = ThreadPoolExecutor(1, "worker-starter")
        self._lock = threading.Lock()  # guards the fields below, never held while waiting
        self._link: WorkerLink | None = None
        self._users: dict[WorkerLink, int] = {}
        self._replacing = False
        self._closed = False
        self._last_start_s = -REVIVAL_PERIOD_S
        self.starts = 0

    @property
    def pid(self) -> int | None:
        """Process ID of the running worker, None where there is none."""
        link = self._link
        return link.pid if link is not None and link.running else None

    @property
    def ready(self) -> bool:
        """Whether the worker has imported everything and takes orders."""
        link = self._link
        return link is not None and link.ready

    @property
    def memory_bytes(self) -> int:
        """Memory that the worker has for itself [bytes]; 0 where there is none."""
        link = self._link
        return 0 if link is None else link.resident_bytes()

    def ensure_started(self) -> None:
        """Start the worker unless one runs. Returns at once; the worker imports meanwhile."""
        with self._lock:
            if self._closed or self.pid is not None:
                return
            if self._link is not None:
                self.on_event(
                    f"The planning process {self._link.pid} was gone "
                    f"({self._link.how_it_ended()}); starting another."
                )
            self._link = self._starter.submit(WorkerLink, self.limits().nice).result()
            self._last_start_s = time.monotonic()
            self.starts += 1

    def revive(self) -> None:
        """Start the worker if none runs and the last start is some time ago; for a timer."""
        if time.monotonic() - self._last_start_s >= REVIVAL_PERIOD_S:
            self.ensure_started()

    def current(self) -> WorkerLink:
        """The worker, started where there is none; it may still be importing.

        Raises
        ------
        SystemFault
            SHUTTING_DOWN after :meth:`close`.
        """
        self.ensure_started()
        with self._lock:
            if self._closed or self._link is None:
                raise shutting_down()
            return self._link

    def is_current(self, link: WorkerLink) -> bool:
        """Whether new orders go to this process."""
        return self._link is link

    def close(self) -> None:
        """End the worker and make running and later calls fail. Idempotent."""
        with self._lock:
            self._closed = True
            links = {*self._users, *([self._link] if self._link is not None else [])}
        for link in links:
            link.end()
        self._starter.shutdown(wait=False)

    def hold(self, link: WorkerLink) -> None:
        """Count an order that a process works on: it is not ended while it is replaced."""
        with self._lock:
            self._users[link] = self._users.get(link, 0) + 1

    @contextmanager
    def in_use(self, link: WorkerLink) -> Iterator[None]:
        """:meth:`hold` a process for one order."""
        self.hold(link)
        try:
            yield
        finally:
            self.release(link)

    def release(self, link: WorkerLink) -> None:
        """An order of a process has ended: replace it where it is too large, end it if replaced."""
        with self._lock:
            self._users[link] -= 1
            idle = self._users[link] == 0
            if idle:
                del self._users[link]
            current = link is self._link
            grown = current and not self._replacing and not self._closed and link.running
            grown = grown and link.resident_bytes() > self.limits().memory_bytes
            self._replacing |= grown
        if grown:
            threading.Thread(target=self._replace, args=(link,), daemon=True).start()
        elif idle and not current:
            link.end()

    def _replace(self, old: WorkerLink) -> None:
        """Start another process beside one that has grown, and hand the work over to it."""
        try:
            successor = self._starter.submit(WorkerLink, self.limits().nice).result()
            try:
                successor.wait_ready(START_LIMIT_S)
            except (TimeoutError, EOFError):
                successor.end()
                return
            megabytes = old.resident_bytes() / 1e6
            with self._lock:
                taken = self._link is old and not self._closed
                if taken:
                    self._link = successor
                    self.starts += 1
                idle = old not in self._users
            if not taken:
                successor.end()
                return
            self.on_event(
                f"The planning process {old.pid} had grown to {megabytes:.0f} MB (parameter "
                f"worker_memory_limit_mb) and was replaced by {successor.pid}."
            )
            if idle:
                old.end()
        except RuntimeError:
            pass  # the node ends: no thread is left to start a process
        finally:
            with self._lock:
                self._replacing = False

    def lost(self, link: WorkerLink) -> GraspPlannerError:
        """End a process that died or hung, start another; return what to tell the caller."""
        link.end()
        with self._lock:
            if self._closed:
                return shutting_down()
            mine = self._link is link  # several may wait for answers; the first one reports
            if mine:
                self._link = None
        how = link.how_it_ended()
        if mine:
            self.on_event(f"The planning process was lost while planning: {how}.")
        self.ensure_started()
        return SystemFault(
            f"The planning process was lost while it worked on this request ({how}) and has been "
            "started anew. Call again; if it happens again with this mesh, report it.",
            ErrorCode.PLANNING_PROCESS_LOST,
        )

    def give_up(self, link: WorkerLink) -> None:
        """End a process that is late, and start another."""
        with self._lock:
            if self._closed:
                return
            mine = self._link is link
            if mine:
                self._link = None
        if mine:
            self.on_event(f"Giving up the planning process {link.pid}.")
        link.end()
        with contextlib.suppress(RuntimeError):
            self.ensure_started()


def shutting_down() -> SystemFault:
    """What is told to whoever asks after the end."""
    return SystemFault(
        "The node is shutting down. Call again when it runs.", ErrorCode.SHUTTING_DOWN
    )
