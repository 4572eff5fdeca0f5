"""Forked children that compute while the planner goes on, and that a deadline can end.

A fork shares the prepared part and the compiled code with its children, so that one starts in
10 ms; a spawned process would need 2 s for its imports alone. A child keeps nothing of the
parent's open files: the planning process's socket must close with the planning process.
"""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection, wait
from types import TracebackType
from typing import Any, Self

from gpis_grasp_planner.errors import RequestError, SystemFault

_MOST_FILES = 4096
_PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None)  # loaded here, since a child must not load anything before it is tied


class ForkedChild:
    """A child process that runs a function with its end of a pipe; a context manager.

    It ends with the thread that made it, however that ends.

    Parameters
    ----------
    serve : callable
        Takes the child's end of the pipe; what it inherits by the fork needs no pickling.
        An exception ends the child, which the parent sees as EOFError.
    forks : bool
        Whether it may have children of its own.
    """

    def __init__(self, serve: Callable[[Connection], None], *, forks: bool = False):
        context = multiprocessing.get_context("fork")
        self.connection, theirs = context.Pipe()
        self._process = context.Process(
            target=_run, args=(serve, theirs, os.getpid()), daemon=not forks
        )
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

    @property
    def pid(self) -> int:
        """Its process ID."""
        return int(self._process.pid or 0)

    def exit_code(self) -> int | None:
        """How a child that closed its end went: -N by signal N; None if it has not ended in 1 s."""
        self._process.join(1.0)
        return self._process.exitcode

    def end(self) -> None:
        """End the child at once. Idempotent."""
        self.connection.close()
        self._process.kill()
        self._process.join()


def _run(serve: Callable[[Connection], None], connection: Connection, parent: int) -> None:
    # The kernel ends the child with the thread that forked it, also where that was killed.
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(0)
    # A Ctrl-C in the terminal is for the parent, which ends its children.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
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


def jobs_asked_for(asked: int | None) -> int:
    """How many things to do at a time: what was asked for, else one for each core.

    Raises
    ------
    RequestError
        For less than one.
    """
    if asked is not None and asked < 1:
        raise RequestError(f"--jobs is {asked}; give at least 1.")
    return asked or usable_cores()


def answer_requests(answer: Callable[[Any], Any], connection: Connection) -> None:
    """Answer every request that comes over a connection, until it closes."""
    while True:
        connection.send(answer(connection.recv()))


def share_out(
    serve: Callable[[Connection], None], requests: Sequence[Any], processes: int
) -> list[Any]:
    """Answers to requests from forked children; whichever is free takes the next request.

    Parameters
    ----------
    serve : callable
        Runs in every child and answers one request after the other, see
        :func:`answer_requests`. An exception that it answers with is raised here.
    requests : sequence
        Anything that can be pickled.
    processes : int
        At least 1; no more children are started than there are requests.

    Returns
    -------
    list
        In the order of the requests.

    Raises
    ------
    SystemFault
        INTERNAL where a child ended before it answered. The other children are ended.
    """
    answers: list[Any] = [None] * len(requests)
    waiting = list(range(len(requests)))[::-1]
    children = [ForkedChild(serve) for _ in range(min(processes, len(requests)))]
    idle = list(children)
    working: dict[Any, tuple[ForkedChild, int]] = {}
    try:
        while waiting or working:
            while idle and waiting:
                child, index = idle.pop(), waiting.pop()
                working[child.connection] = (child, index)
                _send(child, requests[index])
            for ready in wait(list(working)):
                child, index = working.pop(ready)
                answers[index] = _answer(child, index, len(requests))
                idle.append(child)
    finally:
        for child in children:
            child.end()
    return answers


def _send(child: ForkedChild, request: Any) -> None:
    with contextlib.suppress(OSError):  # of a child that is gone, reading its answer tells
        child.connection.send(request)


def _answer(child: ForkedChild, index: int, n: int) -> Any:
    try:
        answer = child.connection.recv()
    except (EOFError, OSError):
        raise SystemFault(
            f"A child process ended (code {child.exit_code()}) before it answered request "
            f"{index + 1} of {n}. Is there enough memory? One process alone shows the error."
        ) from None
    if isinstance(answer, Exception):
        raise answer
    return answer
