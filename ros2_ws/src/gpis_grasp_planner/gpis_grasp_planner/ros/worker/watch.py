"""The planner in a process of its own, watched: it may crash, hang or be killed; the node may not.

It makes one plan at a time, and beside that answers orders to place a plan that exists.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError, PlanningError, SystemFault
from gpis_grasp_planner.plan.progress import Progress
from gpis_grasp_planner.ros.worker.link import Mailbox, WorkerLink
from gpis_grasp_planner.ros.worker.messages import (
    PlaceOrder,
    Plan,
    PlanOrder,
    WorkerAccepted,
    WorkerError,
    WorkerProgress,
)

# Imports and warm-up take 4 s, or a minute and more where nothing is compiled yet.
START_LIMIT_S = 300.0
ACCEPT_LIMIT_S = 5.0
# One that cannot start shall not keep a core busy with attempts.
REVIVAL_PERIOD_S = 10.0


class PlanningProcess:
    """Owner of the worker process; may be used from any thread.

    Parameters
    ----------
    on_event : callable, optional
        Called with one sentence when the process is started, lost or given up.
    """

    def __init__(self, on_event: Callable[[str], None] = lambda _text: None) -> None:
        self._on_event = on_event
        self._lock = threading.Lock()  # guards the fields below, never held while waiting
        self._planning = threading.Lock()
        self._link: WorkerLink | None = None
        self._closed = False
        self._last_start_s = -REVIVAL_PERIOD_S
        self.starts = 0

    @property
    def pid(self) -> int | None:
        """Process ID of the running worker, None where there is none."""
        link = self._link
        return link.pid if link is not None and link.running else None

    @property
    def ready(self) -> bool:
        """Whether the worker has imported everything and takes orders."""
        link = self._link
        return link is not None and link.ready

    @property
    def busy(self) -> bool:
        """Whether a plan is running."""
        return self._planning.locked()

    def ensure_started(self) -> None:
        """Start the worker unless one runs. Returns at once; the worker imports meanwhile."""
        with self._lock:
            if self._closed or self.pid is not None:
                return
            if self._link is not None:
                self._on_event(
                    f"The planning process {self._link.pid} was gone "
                    f"({self._link.how_it_ended()}); starting another."
                )
            self._link = WorkerLink()
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
        on_progress: Callable[[Progress], None] | None = None,
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
            link, box = self._hand_over(order)
            with box:
                try:
                    limit_s = order.request.time_budget_s + grace_s
                    return _plan_from(box, limit_s, on_progress)
                except TimeoutError:
                    self._give_up(link)
                    raise PlanningError(
                        f"The plan did not end within its time budget of "
                        f"{order.request.time_budget_s:g} s and {grace_s:g} s of grace (parameter "
                        "planning_grace_s); the planning process was restarted. Try again, with a "
                        "larger grace on a slow machine.",
                        ErrorCode.DEADLINE_EXCEEDED,
                    ) from None
                except (EOFError, OSError) as error:
                    raise self._lost(link) from error

    def place(self, order: PlaceOrder, grace_s: float) -> Plan:
        """Answer a plan for a place, also while another plan is made.

        Parameters
        ----------
        order : PlaceOrder
        grace_s : float
            Given up this long after the order's time budget [s].

        Raises
        ------
        SystemFault, PlanningError, GraspPlannerError
            As :meth:`plan`; but where the worker dies, the order is given to the next one once,
            and where it is late, the worker goes on.
        """
        lost: GraspPlannerError | None = None
        budget_s = order.request.time_budget_s
        for _ in range(2):
            link, box = self._hand_over(order)
            with box:
                try:
                    return _plan_from(box, budget_s + grace_s, None)
                except TimeoutError:
                    raise PlanningError(
                        f"The answer for this place was not ready {grace_s:g} s (parameter "
                        f"planning_grace_s) after its time budget of {budget_s:g} s. "
                        "Call again, with fewer obstacles or fewer uncertainty.samples.",
                        ErrorCode.DEADLINE_EXCEEDED,
                    ) from None
                except (EOFError, OSError):
                    # Not this order's fault, as far as is known: a plan beside it may have died.
                    lost = self._lost(link)
        assert lost is not None
        raise lost

    def close(self) -> None:
        """End the worker and make running and later calls fail. Idempotent."""
        with self._lock:
            self._closed = True
            if self._link is not None:
                self._link.end()

    def _hand_over(self, order: PlanOrder | PlaceOrder) -> tuple[WorkerLink, Mailbox]:
        """Give the worker an order; once more if it died, or hung, before it took it."""
        for last_try in (False, True):
            self.ensure_started()
            link = self._open_link()
            box: Mailbox | None = None
            try:
                link.wait_ready(START_LIMIT_S)
                box = link.send(order)
                box.wait_for(WorkerAccepted, ACCEPT_LIMIT_S)
            except (EOFError, OSError) as error:
                fault = self._lost(link)
                if last_try or fault.code != ErrorCode.PLANNING_PROCESS_LOST:
                    raise fault from error
            else:
                return link, box
        raise AssertionError("unreachable")

    def _open_link(self) -> WorkerLink:
        with self._lock:
            if self._closed or self._link is None:
                raise _shutting_down()
            return self._link

    def _lost(self, link: WorkerLink) -> GraspPlannerError:
        link.end()
        with self._lock:
            if self._closed:
                return _shutting_down()
            mine = self._link is link  # several may wait for answers; the first one reports
            if mine:
                self._link = None
        how = link.how_it_ended()
        if mine:
            self._on_event(f"The planning process was lost while planning: {how}.")
        self.ensure_started()
        return SystemFault(
            f"The planning process was lost while it worked on this request ({how}) and has been "
            "started anew. Call again; if it happens again with this mesh, report it.",
            ErrorCode.PLANNING_PROCESS_LOST,
        )

    def _give_up(self, link: WorkerLink) -> None:
        with self._lock:
            if self._closed:
                return
            mine = self._link is link
            if mine:
                self._link = None
        if mine:
            self._on_event(f"Giving up the planning process {link.pid}.")
        link.end()
        self.ensure_started()


def _plan_from(
    box: Mailbox, limit_s: float, on_progress: Callable[[Progress], None] | None
) -> Plan:
    deadline = time.monotonic() + limit_s
    while True:
        message = box.get(deadline - time.monotonic())
        if isinstance(message, Plan):
            return message
        if isinstance(message, WorkerError):
            raise GraspPlannerError(message.message, message.code)
        if isinstance(message, WorkerProgress) and on_progress is not None:
            on_progress(message.progress)


def _shutting_down() -> SystemFault:
    return SystemFault(
        "The node is shutting down. Call again when it runs.", ErrorCode.SHUTTING_DOWN
    )
