"""One run of the planning process and the socket pair to it: orders out, answers in, by number."""

from __future__ import annotations

import contextlib
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
from typing import Any

import gpis_grasp_planner
from gpis_grasp_planner.ros.worker.messages import CancelOrder, WorkerReady

PACKAGE_PARENT = Path(gpis_grasp_planner.__file__).parents[1]
MODULE = "gpis_grasp_planner.ros.worker.main"
# A process that was stopped takes nothing more once the socket's buffer is full.
SEND_LIMIT_S = 10


_INTERRUPTION = object()


class Replies:
    """Where the answers to one order arrive, in their order."""

    def __init__(self, link: WorkerLink, number: int) -> None:
        self._link = link
        self._number = number
        self.messages: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def close(self) -> None:
        """End the delivery; what comes later is dropped. Idempotent."""
        self._link.forget(self._number)

    def cancel(self) -> None:
        """Tell the process that the order is not wanted any more. It may answer all the same."""
        self._link.cancel(self._number)

    def interrupt(self) -> None:
        """Let a waiting :meth:`get` raise InterruptedError now; from any thread."""
        self.messages.put(_INTERRUPTION)

    def get(self, limit_s: float) -> Any:
        """The next message.

        Raises
        ------
        TimeoutError
            If none comes within `limit_s` seconds.
        EOFError
            If the process is gone.
        InterruptedError
            After :meth:`interrupt`.
        """
        try:
            message = self.messages.get(timeout=max(limit_s, 0.0))
        except queue.Empty:
            raise TimeoutError(f"no message within {limit_s:g} s") from None
        if message is None:
            self.messages.put(None)  # for whoever asks again
            raise EOFError
        if message is _INTERRUPTION:
            raise InterruptedError
        return message


class WorkerLink:
    """Starts the process; a thread delivers what it sends to those who wait for it.

    Started as ``python -m``: not forked, since the node has threads, and not by multiprocessing's
    spawn, which would import the node once more. The process ends by itself when its end of the
    pair closes, so that it cannot outlive the node even if that is killed with SIGKILL; where it
    is stopped at that moment, the system ends it. That is bound to the thread which makes this
    object: it must live as long as the node.

    Parameters
    ----------
    nice : int
        The process's nice value over that of this one.
    """

    def __init__(self, nice: int = 0) -> None:
        self._connection, theirs = Pipe()
        _limit_sending(self._connection)
        environment = dict(os.environ)
        # 30 MB: arrays of this size and more go back to the system at once. By default glibc
        # raises the limit as they come, and keeps the gaps that they leave.
        environment.setdefault("MALLOC_MMAP_THRESHOLD_", "262144")
        paths = [str(PACKAGE_PARENT), environment.get("PYTHONPATH", "")]
        environment["PYTHONPATH"] = os.pathsep.join(p for p in paths if p)
        self._process = subprocess.Popen(
            [sys.executable, "-m", MODULE, str(theirs.fileno()), str(os.getpid()), str(nice)],
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
        self._boxes: dict[int, Replies] = {}
        self._last_number = 0
        self._lost = False
        self._heard = threading.Event()  # it is ready, or lost
        self.started_s = self.heard_s = time.monotonic()
        threading.Thread(target=self._receive, args=(self._connection,), daemon=True).start()

    @property
    def running(self) -> bool:
        """Whether the process runs."""
        return self._process.poll() is None

    @property
    def ready(self) -> bool:
        """Whether it has imported everything and takes orders."""
        return self._heard.is_set() and not self._lost and self.running

    @property
    def silent_s(self) -> float:
        """Time since anything came from it [s]; it says every second that it is there."""
        return time.monotonic() - self.heard_s

    @property
    def stopped(self) -> bool:
        """Whether a signal has stopped the process; False where the system does not tell."""
        try:
            stat = Path(f"/proc/{self.pid}/stat").read_text()
        except OSError:
            return False
        return stat.rpartition(") ")[2][:1] in ("T", "t")

    def wait_ready(self, limit_s: float) -> None:
        """Wait until it takes orders. Raises TimeoutError, or EOFError if it is gone."""
        if not self._heard.wait(limit_s):
            raise TimeoutError(f"not ready within {limit_s:g} s")
        if self._lost:
            raise EOFError

    def resident_bytes(self) -> int:
        """Memory of the process that is its own [bytes]; 0 where that cannot be read."""
        try:
            fields = Path(f"/proc/{self.pid}/statm").read_text().split()
        except OSError:
            return 0
        return (int(fields[1]) - int(fields[2])) * os.sysconf("SC_PAGE_SIZE")

    def send(self, order: object) -> Replies:
        """Send an order; its answers come into the mailbox. Raises OSError if it is gone."""
        with self._lock:
            self._last_number += 1
            number = self._last_number
            box = self._boxes[number] = Replies(self, number)
            if self._lost:
                box.messages.put(None)
        try:
            with self._sending:
                self._connection.send((number, order))
        except BaseException:
            self.forget(number)
            raise
        return box

    def cancel(self, number: int) -> None:
        """Tell the process that an order is not wanted any more."""
        with contextlib.suppress(OSError), self._sending:
            self._connection.send((number, CancelOrder()))

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
                self.heard_s = time.monotonic()
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
