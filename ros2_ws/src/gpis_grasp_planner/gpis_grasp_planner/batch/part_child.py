"""A forked child for one part: a crash or a hang costs this part, no more.

The parent has loaded the planner, so that a child starts in some 10 ms.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from gpis_grasp_planner.errors import ErrorCode, SystemFault
from gpis_grasp_planner.forked_child import ForkedChild


class PartChild:
    """A child that works on one part and answers once; end it in any case.

    Parameters
    ----------
    work : callable
        What the child does; what it returns is the answer.
    limit_s : float [s]
        After this time it is given up.
    """

    def __init__(self, work: Callable[[], Any], limit_s: float) -> None:
        def serve(connection: Connection) -> None:
            connection.send(work())

        self._began = time.monotonic()
        self._limit_s = limit_s
        self._child = ForkedChild(serve, forks=True)

    @property
    def connection(self) -> Connection:
        """What can be read from when the child has answered or ended."""
        return self._child.connection

    @property
    def elapsed_s(self) -> float:
        """Since it began [s]."""
        return time.monotonic() - self._began

    @property
    def late(self) -> bool:
        """Whether it has to be given up."""
        return self.elapsed_s > self._limit_s

    def answer(self) -> Any:
        """What the child answered; waits for it, at most until the limit.

        Raises
        ------
        SystemFault
            PLANNING_PROCESS_LOST where it ended before it answered, or took too long.
        """
        try:
            if not self.connection.poll(max(0.0, self._limit_s - self.elapsed_s)):
                raise SystemFault(
                    f"It was given up after {self._limit_s:.0f} s. Plan it alone to see why.",
                    ErrorCode.PLANNING_PROCESS_LOST,
                )
            return self.connection.recv()
        except (EOFError, OSError):
            raise SystemFault(
                f"Its process ended (code {self._child.exit_code()}) before it answered. Is there "
                "enough memory? Plan it alone to see why.",
                ErrorCode.PLANNING_PROCESS_LOST,
            ) from None
        finally:
            self.end()

    def end(self) -> None:
        """End the child at once. Idempotent."""
        self._child.end()
