"""One line on a terminal's stderr that says what is being done, with a clock that never stands.

It appears after 0.2 s, before the planner's libraries are loaded, and is gone before a result is
printed. Where stderr is no terminal nothing is written.
"""

from __future__ import annotations

import os
import shutil
import sys
import threading
import time
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from gpis_grasp_planner.plan.progress import Progress

_FIRST_S = 0.2
_INTERVAL_S = 0.1
_ERASE = "\r\x1b[K"


class StatusLine:
    """Shows phase and clock while its ``with`` block runs.

    Parameters
    ----------
    phase : str
        What is done first.
    """

    def __init__(self, phase: str):
        self._phase = phase
        self._details = ""
        self._start = time.monotonic()
        self._done = threading.Event()
        self._lock = threading.Lock()  # of the screen
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Self:
        if sys.stderr.isatty() and os.environ.get("TERM") != "dumb":
            self._thread = threading.Thread(target=self._tick, daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        if self._thread is not None:
            self._thread.join()
            self._write(_ERASE)

    def enter(self, phase: str) -> None:
        """Another phase begins, with a clock of its own."""
        self._phase, self._details, self._start = phase, "", time.monotonic()

    def show(self, progress: Progress) -> None:
        """What the planner says on its way; its phases are shown by their names."""
        self._phase = str(progress.phase)
        self._start = time.monotonic() - progress.elapsed_s  # the budget's clock, not ours
        details = f" of {progress.time_budget_s:g} s, {progress.evaluations} attempts"
        if progress.best_epsilon > 0.0:
            details += f", best epsilon {progress.best_epsilon:.4f}"
        if progress.n_tried:
            details += f", {progress.n_held} of {progress.n_tried} held in physics"
        self._details = details

    def note(self, message: str) -> None:
        """Write a line of its own, above this one."""
        with self._lock:
            self._write((_ERASE if self._thread is not None else "") + message + "\n")

    def text(self) -> str:
        """The line as it is now."""
        elapsed = time.monotonic() - self._start
        clock = f"{elapsed:.1f}" if self._details else f"{elapsed:.1f} s"
        return f"{self._phase}: {clock}{self._details}"

    def _tick(self) -> None:
        if self._done.wait(_FIRST_S):
            return
        while True:
            width = shutil.get_terminal_size().columns - 1
            with self._lock:
                self._write(_ERASE + self.text()[:width])
            if self._done.wait(_INTERVAL_S):
                return

    def _write(self, text: str) -> None:
        # Past Python's buffer and its lock, which a forked child could find taken.
        sys.stderr.flush()
        try:
            file = sys.stderr.fileno()
        except OSError:  # Python code has put something else in its place
            sys.stderr.write(text)
            return
        os.write(file, text.encode())
