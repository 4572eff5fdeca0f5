"""One request on its way through the node: when it came, and whether it is still wanted."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from gpis_grasp_msgs.msg import Grasp as GraspMessage
from gpis_grasp_planner.errors import ErrorCode, PlanningError
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.plan.progress import Progress


class Call:
    """A request of the service or the action; may be used from any thread.

    Attributes
    ----------
    start : float
        When it came, by ``time.monotonic``.
    progress : Progress or None
        How far the work is by the last report, None before it has begun.
    show : callable
        Makes a message of a grasp, where the part of this request lies.
    admitted : bool
        Whether it has had a turn: it then waits for further ones, however many others do.
    """

    def __init__(self) -> None:
        self.start = time.monotonic()
        self.progress: Progress | None = None
        self.show: Callable[[Grasp], GraspMessage] = lambda _grasp: GraspMessage()
        self.admitted = False
        self._lock = threading.Lock()
        self._why = ""
        self._wake_ups: list[Callable[[], None]] = []

    @property
    def elapsed_s(self) -> float:
        """Time since the request came [s]."""
        return time.monotonic() - self.start

    @property
    def cancelled(self) -> bool:
        """Whether nobody wants the answer any more."""
        return bool(self._why)

    @property
    def why_cancelled(self) -> str:
        """A sentence for the answer's message; "" while the answer is wanted."""
        return self._why

    def cancel(self, why: str) -> None:
        """Say that the answer is not wanted any more, and wake who waits for it. Idempotent.

        Parameters
        ----------
        why : str
            A sentence for the answer's message.
        """
        with self._lock:
            if self._why:
                return
            self._why = why
            waiting = list(self._wake_ups)
        for wake_up in waiting:
            wake_up()

    @contextmanager
    def woken_by(self, wake_up: Callable[[], None]) -> Iterator[None]:
        """Inside, a cancel calls `wake_up`; at once where it has come already."""
        with self._lock:
            self._wake_ups.append(wake_up)
            cancelled = bool(self._why)
        if cancelled:
            wake_up()
        try:
            yield
        finally:
            with self._lock:
                self._wake_ups.remove(wake_up)

    def check_wanted(self) -> None:
        """Raise PlanningError with the code CANCELLED once the answer is not wanted any more."""
        if self._why:
            raise PlanningError(self._why, ErrorCode.CANCELLED)
