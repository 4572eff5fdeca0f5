"""Forked children that compute while the planner goes on, and that a deadline can end.

A fork shares the prepared part and the compiled code with its children, so that one starts in
10 ms; a spawned process would need 2 s for its imports alone. A child keeps nothing of the
parent's open files: the planning process's socket must close with the planning process.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, Self

_MOST_FILES = 4096


class ForkedChild:
    """A child process that runs a function with its end of a pipe; a context manager.

    Parameters
    ----------
    serve : callable
        Takes the child's end of the pipe; what it inherits by the fork needs no pickling.
        An exception ends the child, which the parent sees as EOFError.
    """

    def __init__(self, serve: Callable[[Connection], None]):
        context = multiprocessing.get_context("fork")
        self.connection, theirs = context.Pipe()
        self._process = context.Process(target=_run, args=(serve, theirs), daemon=True)
        self._process.start()
        theirs.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.end()

    def end(self) -> None:
        """End the child at once. Idempotent."""
        self.connection.close()
        self._process.kill()
        self._process.join()


def _run(serve: Callable[[Connection], None], connection: Connection) -> None:
    # A Ctrl-C in the terminal is for the parent, which ends its children.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    kept = connection.fileno()
    os.closerange(3, kept)
    os.closerange(kept + 1, _MOST_FILES)
    try:
        serve(connection)
    except (EOFError, OSError):
        pass  # the parent is gone, or wants no more
    finally:
        os._exit(0)


def usable_cores() -> int:
    """Cores that this process may run on."""
    return len(os.sched_getaffinity(0))


def answer_requests(answer: Callable[[Any], Any], connection: Connection) -> None:
    """Answer every request that comes over a connection, until it closes."""
    while True:
        connection.send(answer(connection.recv()))
