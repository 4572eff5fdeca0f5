"""One run of the planning process and the socket pair to it: orders out, answers in, by number."""

from __future__ import annotations

import os
import queue
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import gpis_grasp_planner
from gpis_grasp_planner.ros.worker.messages import WorkerReady

PACKAGE_PARENT = Path(gpis_grasp_planner.__file__).parents[1]
MODULE = "gpis_grasp_planner.ros.worker.main"
# A process that was stopped takes nothing more once the socket's buffer is full.
SEND_LIMIT_S = 10


class Mailbox:
    """Where the answers to one order arrive; a context manager that ends their delivery."""

    def __init__(self, link: WorkerLink, number: int) -> None:
        self._link = link
        self._number = number
        self.messages: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._link.forget(self._number)

    def get(self, limit_s: float) -> Any:
        """The next message.

        Raises
        ------
        TimeoutError
            If none comes within `limit_s` seconds.
        EOFError
            If the process is gone.
        """
        try:
            message = self.messages.get(timeout=max(limit_s, 0.0))
        except queue.Empty:
            raise TimeoutError(f"no message within {limit_s:g} s") from None
        if message is None:
            raise EOFError
        return message

    def wait_for(self, kind: type, limit_s: float) -> None:
        """Wait for a message of a kind, and drop others. Raises as :meth:`get`."""
        deadline = time.monotonic() + limit_s
        while not isinstance(self.get(deadline - time.monotonic()), kind):
            pass


class WorkerLink:
    """Starts the process; a thread delivers what it sends to those who wait for it.

    Started as ``python -m``: not forked, since the node has threads, and not by multiprocessing's
    spawn, which would import the node once more. The process ends by itself when its end of the
    pair closes, so that it cannot outlive the node even if that is killed with SIGKILL.
    """

    def __init__(self) -> None:
        self._connection, theirs = Pipe()
        _limit_sending(self._connection)
        environment = dict(os.environ)
        # 30 MB: arrays of this size and more go back to the system at once. By default glibc
        # raises the limit as they come, and keeps the gaps that they leave.
        environment.setdefault("MALLOC_MMAP_THRESHOLD_", "262144")
        paths = [str(PACKAGE_PARENT), environment.get("PYTHONPATH", "")]
        environment["PYTHONPATH"] = os.pathsep.join(p for p in paths if p)
        self._process = subprocess.Popen(
            [sys.executable, "-m", MODULE, str(theirs.fileno())],
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
            env=environment,
            # A Ctrl-C in the terminal is for the node, which then stops the worker.
            start_new_session=True,
        )
        theirs.close()
        self.pid = self._process.pid
        self._lock = threading.Lock()  # guards the boxes and the flag below
        self._sending = threading.Lock()
        self._boxes: dict[int, Mailbox] = {}
        self._last_number = 0
        self._lost = False
        self._heard = threading.Event()  # it is ready, or lost
        threading.Thread(target=self._receive, args=(self._connection,), daemon=True).start()

    @property
    def running(self) -> bool:
        """Whether the process runs."""
        return self._process.poll() is None

    @property
    def ready(self) -> bool:
        """Whether it has imported everything and takes orders."""
        return self._heard.is_set() and not self._lost and self.running

    def wait_ready(self, limit_s: float) -> None:
        """Wait until it takes orders. Raises TimeoutError, or EOFError if it is gone."""
        if not self._heard.wait(limit_s):
            raise TimeoutError(f"not ready within {limit_s:g} s")
        if self._lost:
            raise EOFError

    def send(self, order: object) -> Mailbox:
        """Send an order; its answers come into the mailbox. Raises OSError if it is gone."""
        with self._lock:
            self._last_number += 1
            number = self._last_number
            box = self._boxes[number] = Mailbox(self, number)
            if self._lost:
                box.messages.put(None)
        try:
            with self._sending:
                self._connection.send((number, order))
        except BaseException:
            self.forget(number)
            raise
        return box

    def forget(self, number: int) -> None:
        """Drop further answers to an order."""
        with self._lock:
            self._boxes.pop(number, None)

    def end(self) -> None:
        """End the process. Idempotent; who waits for an answer gets EOFError."""
        # SIGKILL: it holds nothing that needs care, and it also ends a stopped process.
        self._process.kill()
        self._process.wait()

    def how_it_ended(self) -> str:
        """In words, for messages."""
        code = self._process.returncode
        if code is None or code >= 0:
            return f"it ended with exit code {code}"
        try:
            return f"it was ended by {signal.Signals(-code).name}"
        except ValueError:
            return f"it was ended by signal {-code}"

    def _receive(self, connection: Connection) -> None:
        try:
            while True:
                number, message = connection.recv()
                if isinstance(message, WorkerReady):
                    self._heard.set()
                with self._lock:
                    box = self._boxes.get(number)
                    if box is not None:
                        box.messages.put(message)
        except (EOFError, OSError):
            pass
        finally:
            with self._lock:
                self._lost = True
                for box in self._boxes.values():
                    box.messages.put(None)
            self._heard.set()
            with self._sending:
                connection.close()


def _limit_sending(connection: Connection) -> None:
    """Let a send that makes no progress fail with OSError instead of waiting for ever."""
    with socket.socket(fileno=os.dup(connection.fileno())) as end:
        limit = struct.pack("ll", SEND_LIMIT_S, 0)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)
