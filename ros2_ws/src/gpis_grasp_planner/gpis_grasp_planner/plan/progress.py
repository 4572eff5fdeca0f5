"""Where a running plan is, when it has to end, and whether anybody still wants it.

One :class:`Monitor` accompanies a request from its first byte read to its answer. Every piece of
work asks it between two steps, so that no phase is silent or cannot be stopped.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from gpis_grasp_planner.grasp.grasp import Grasp

PROGRESS_INTERVAL_S = 0.1


class Phase(StrEnum):
    """What a request goes through, in this order; a phase that is not needed is left out."""

    READING = "reading"
    PREPARING = "preparing"
    SEARCHING = "searching"
    TRYING = "trying"
    PLACING = "placing"


@dataclass(frozen=True)
class Progress:
    """Where a running plan is.

    Attributes
    ----------
    phase : Phase
    elapsed_s, time_budget_s : float [s]
        Since the request, and what it may take.
    evaluations : int
        Grasps attempted.
    best_epsilon : float
        Of the search so far, -1 where there is no grasp with force closure yet.
    n_candidates : int
        Grasps with force closure that are kept.
    n_tried, n_held : int
        Grasps tried in physics so far, and those of them that held.
    best_held : Grasp or None
        The best of these, in the part's frame.
    """

    phase: Phase
    elapsed_s: float
    time_budget_s: float
    evaluations: int = 0
    best_epsilon: float = -1.0
    n_candidates: int = 0
    n_tried: int = 0
    n_held: int = 0
    best_held: Grasp | None = None

    @property
    def share_done(self) -> float:
        """Share of the time budget that is used, at most 1."""
        return min(self.elapsed_s / self.time_budget_s, 1.0)


class Monitor:
    """The clock of one request, and its line to whoever asked.

    Parameters
    ----------
    time_budget_s : float [s]
        Counted from the making of this object, less `reading_s`.
    on_progress : callable, optional
        Called with a Progress at each new phase and then some ten times a second.
    should_stop : callable, optional
        True once the request is not wanted any more. It is not asked again after that.
    clock : callable
        Seconds, steady.
    reading_s : float [s]
        What reading the part took before this object was made. It counts, but half of the budget
        is left after it: a mesh that took long to read is not refused for that.

    Attributes
    ----------
    start, deadline : float
        By the clock.
    phase_s : dict of Phase to float [s]
        Time spent in each phase so far.
    cancelled : bool
        Whether `should_stop` has said so.
    """

    def __init__(
        self,
        time_budget_s: float,
        on_progress: Callable[[Progress], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
        clock: Callable[[], float] = time.monotonic,
        *,
        reading_s: float = 0.0,
    ):
        self.now = clock
        now = clock()
        self.start = now - reading_s
        self.time_budget_s = time_budget_s
        self.deadline = max(self.start + time_budget_s, now + 0.5 * time_budget_s)
        self.phase_s: dict[Phase, float] = {Phase.READING: reading_s} if reading_s else {}
        self.cancelled = False
        self._on_progress = on_progress
        self._should_stop = should_stop
        self._phase = Phase.READING
        self._due = self.start
        self._figures: dict[str, Any] = {}

    @property
    def elapsed_s(self) -> float:
        """Time since the request [s]."""
        return self.now() - self.start

    @property
    def left_s(self) -> float:
        """Time until the deadline [s]; negative after it."""
        return self.deadline - self.now()

    @contextmanager
    def phase(self, phase: Phase) -> Iterator[None]:
        """Count what is done inside to a phase, and tell its beginning at once."""
        outer, start = self._phase, self.now()
        self._phase = phase
        self._tell()
        try:
            yield
        finally:
            self.phase_s[phase] = self.phase_s.get(phase, 0.0) + self.now() - start
            self._phase = outer

    def update(self, **figures: Any) -> None:
        """Set figures of the coming reports: fields of Progress by name.

        A further grasp that held is told at the next :meth:`stopped`, whenever the last report was.
        """
        if figures.get("n_held", 0) > self._figures.get("n_held", 0):
            self._due = self.now()
        self._figures.update(figures)

    def stopped(self) -> bool:
        """Report if it is time to, and ask whether the request is still wanted. 1 us."""
        if self._on_progress is not None and self.now() >= self._due:
            self._tell()
        if not self.cancelled and self._should_stop is not None:
            self.cancelled = bool(self._should_stop())
        return self.cancelled

    def _tell(self) -> None:
        if self._on_progress is None:
            return
        self._due = self.now() + PROGRESS_INTERVAL_S
        self._on_progress(
            Progress(self._phase, self.elapsed_s, self.time_budget_s, **self._figures)
        )
