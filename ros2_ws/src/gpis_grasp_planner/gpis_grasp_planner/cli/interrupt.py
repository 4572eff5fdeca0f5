"""Ctrl-C that keeps what was found: the first asks the planner to stop, the second ends all."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def stop_on_interrupt(say: Callable[[str], None]) -> Iterator[Callable[[], bool]]:
    """Yield what is true from the first SIGINT on; a second one raises KeyboardInterrupt.

    Forked children have the same handler: a Ctrl-C, which reaches them as well, leaves it to
    their parent to end them.
    """
    asked = threading.Event()

    def stop(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        if asked.is_set():
            raise KeyboardInterrupt
        asked.set()
        say("gpis-grasp: stopping with what was found; Ctrl-C again ends at once")

    if threading.current_thread() is not threading.main_thread():
        yield asked.is_set
        return
    before = signal.signal(signal.SIGINT, stop)
    try:
        yield asked.is_set
    finally:
        signal.signal(signal.SIGINT, before)


def raise_on_signals() -> None:
    """Have SIGINT and SIGTERM raise KeyboardInterrupt from now on.

    A shell starts what it runs in the background with SIGINT ignored, and Python leaves it so.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
