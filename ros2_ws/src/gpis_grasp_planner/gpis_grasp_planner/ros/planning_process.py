"""The planner in a process of its own, watched: it may crash, hang or be killed; the node may not.

The process is started as ``python -m gpis_grasp_planner.ros.planning_worker`` (not forked: the
node has threads; not multiprocessing's spawn: that would import the node once more) and talks
over a socket pair. It ends by itself when its end of the pair closes, so that it cannot outlive
the node even if that is killed with SIGKILL.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

import gpis_grasp_planner
from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError, PlanningError, SystemFault
from gpis_grasp_planner.ros.planned import (
    Plan,
    PlanOrder,
    WorkerAccepted,
    WorkerError,
    WorkerProgress,
    WorkerReady,
)

PACKAGE_PARENT = Path(gpis_grasp_planner.__file__).parents[1]
POLL_S = 0.05
# Imports and warm-up take 4 s, or a minute and more where nothing is compiled yet.
START_LIMIT_S = 300.0
ACCEPT_LIMIT_S = 5.0
# One that cannot start shall not keep a core busy with attempts.
REVIVAL_PERIOD_S = 10.0


class PlanningProcess:
    """Owner of the worker process; one plan at a time, from any thread.

    Parameters
    ----------
    on_event : callable, optional
        Called with one sentence when the process is started, lost or given up.
    """

    def __init__(self, on_event: Callable[[str], None] = lambda _text: None) -> None:
        self._on_event = on_event
        self._lock = threading.Lock()  # guards the fields below, never held while waiting
        self._planning = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection | None = None
        self._ready = False
        self._closed = False
        self._last_start_s = -REVIVAL_PERIOD_S
        self.starts = 0

    @property
    def pid(self) -> int | None:
        """Process ID of the running worker, None where there is none."""
        process = self._process
        return None if process is None or process.poll() is not None else process.pid

    @property
    def ready(self) -> bool:
        """Whether the worker has imported everything and takes orders."""
        if self._planning.acquire(blocking=False):  # a plan reads the connection itself
            try:
                connection = self._connection
                if not self._ready and connection is not None and connection.poll():
                    self._ready = isinstance(connection.recv(), WorkerReady)
            except (EOFError, OSError):
                self._ready = False
            finally:
                self._planning.release()
        return self._ready and self.pid is not None

    @property
    def busy(self) -> bool:
        """Whether a plan is running."""
        return self._planning.locked()

    def ensure_started(self) -> None:
        """Start the worker unless one runs. Returns at once; the worker imports meanwhile."""
        with self._lock:
            if self._closed or self.pid is not None:
                return
            if self._process is not None:
                self._on_event(
                    f"The planning process {self._process.pid} was gone "
                    f"({_how(self._process.returncode)}); starting another."
                )
                self._dispose()
            ours, theirs = Pipe()
            environment = dict(os.environ)
            # One core per plan: figures are those of one core, and the node's threads stay free.
            for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
                environment.setdefault(name, "1")
            # 30 MB: arrays of this size and more go back to the system at once. By default glibc
            # raises the limit as they come, and keeps the gaps that they leave.
            environment.setdefault("MALLOC_MMAP_THRESHOLD_", "262144")
            paths = [str(PACKAGE_PARENT), environment.get("PYTHONPATH", "")]
            environment["PYTHONPATH"] = os.pathsep.join(p for p in paths if p)
            module = "gpis_grasp_planner.ros.planning_worker"
            self._process = subprocess.Popen(
                [sys.executable, "-m", module, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                env=environment,
                # A Ctrl-C in the terminal is for the node, which then stops the worker.
                start_new_session=True,
            )
            theirs.close()
            self._connection = ours
            self._ready = False
            self._last_start_s = time.monotonic()
            self.starts += 1

    def revive(self) -> None:
        """Start the worker if none runs and the last start is some time ago; for a timer."""
        if time.monotonic() - self._last_start_s >= REVIVAL_PERIOD_S:
            self.ensure_started()

    def plan(
        self,
        order: PlanOrder,
        grace_s: float,
        on_progress: Callable[[WorkerProgress], None] | None = None,
    ) -> Plan:
        """Make a plan in the worker.

        Parameters
        ----------
        order : PlanOrder
        grace_s : float
            The worker is given up this long after the order's time budget [s].
        on_progress : callable, optional

        Raises
        ------
        SystemFault
            PLANNING_PROCESS_LOST if the worker died, SHUTTING_DOWN after :meth:`close`.
        PlanningError
            DEADLINE_EXCEEDED if it did not answer in time; it is killed and started anew.
        GraspPlannerError
            What the planner itself raised, with its code.
        """
        with self._planning:
            if not self._hand_over(order):
                # It was lost before it began, so the order is not to blame: once more.
                self._hand_over(order, last_try=True)
            try:
                return self._wait_plan(self._open_connection(), order, grace_s, on_progress)
            except (EOFError, OSError) as error:
                raise self._lost() from error

    def close(self) -> None:
        """End the worker and make running and later calls of :meth:`plan` fail. Idempotent."""
        with self._lock:
            self._closed = True
            if self._process is not None:
                self._end_process(self._process)

    def _hand_over(self, order: PlanOrder, last_try: bool = False) -> bool:
        """Give the worker an order; False if it died, or hung, before it began."""
        self.ensure_started()
        try:
            connection = self._open_connection()
            self._wait_ready(connection)
            connection.send(order)
            self._wait_for(connection, WorkerAccepted, ACCEPT_LIMIT_S)
        except (EOFError, OSError) as error:
            fault = self._lost()
            if last_try or fault.code != ErrorCode.PLANNING_PROCESS_LOST:
                raise fault from error
            return False
        return True

    def _open_connection(self) -> Connection:
        with self._lock:
            if self._closed or self._connection is None:
                raise _shutting_down()
            return self._connection

    def _wait_ready(self, connection: Connection) -> None:
        if not self._ready:
            self._wait_for(connection, WorkerReady, START_LIMIT_S)
            self._ready = True

    def _wait_for(self, connection: Connection, kind: type, limit_s: float) -> None:
        deadline = time.monotonic() + limit_s
        while time.monotonic() < deadline:
            if connection.poll(POLL_S) and isinstance(connection.recv(), kind):
                return
        raise TimeoutError(f"no {kind.__name__} within {limit_s:g} s")

    def _wait_plan(
        self,
        connection: Connection,
        order: PlanOrder,
        grace_s: float,
        on_progress: Callable[[WorkerProgress], None] | None,
    ) -> Plan:
        budget_s = order.request.time_budget_s
        deadline = time.monotonic() + budget_s + grace_s
        while True:
            left = deadline - time.monotonic()
            if left <= 0.0:
                self._give_up()
                raise PlanningError(
                    f"The plan did not end within its time budget of {budget_s:g} s "
                    f"and {grace_s:g} s of grace (parameter planning_grace_s); the planning "
                    "process was restarted. Try again, with a larger grace on a slow machine.",
                    ErrorCode.DEADLINE_EXCEEDED,
                )
            if not connection.poll(min(left, POLL_S)):
                continue
            message = connection.recv()
            if isinstance(message, Plan):
                return message
            if isinstance(message, WorkerError):
                raise GraspPlannerError(message.message, message.code)
            if isinstance(message, WorkerProgress) and on_progress is not None:
                on_progress(message)

    def _lost(self) -> GraspPlannerError:
        with self._lock:
            if self._closed:
                return _shutting_down()
            process = self._process
            how = "it could not be started"
            if process is not None:
                self._end_process(process)
                how = _how(process.returncode)
            self._dispose()
        self._on_event(f"The planning process was lost while planning: {how}.")
        self.ensure_started()
        return SystemFault(
            f"The planning process was lost while it worked on this request ({how}) and has been "
            "started anew. Call again; if it happens again with this mesh, report it.",
            ErrorCode.PLANNING_PROCESS_LOST,
        )

    def _give_up(self) -> None:
        with self._lock:
            if self._closed:
                return
            if self._process is not None:
                self._on_event(f"Giving up the planning process {self._process.pid}.")
                self._end_process(self._process)
            self._dispose()
        self.ensure_started()

    def _dispose(self) -> None:
        if self._connection is not None:
            self._connection.close()
        self._connection = None
        self._process = None
        self._ready = False

    @staticmethod
    def _end_process(process: subprocess.Popen[bytes]) -> None:
        # SIGKILL: it holds nothing that needs care, and it also ends a stopped process.
        process.kill()
        process.wait()


def _shutting_down() -> SystemFault:
    return SystemFault(
        "The node is shutting down. Call again when it runs.", ErrorCode.SHUTTING_DOWN
    )


def _how(returncode: int | None) -> str:
    if returncode is None or returncode >= 0:
        return f"it ended with exit code {returncode}"
    try:
        return f"it was ended by {signal.Signals(-returncode).name}"
    except ValueError:
        return f"it was ended by signal {-returncode}"
