"""The planner in a process of its own, watched: it may crash, hang or be killed; the node may not.

It makes one plan at a time, and beside that answers from plans that exist.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError, PlanningError
from gpis_grasp_planner.plan.progress import Phase
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.work_queue import Lane
from gpis_grasp_planner.ros.worker.link import Replies, WorkerLink
from gpis_grasp_planner.ros.worker.messages import (
    DescribeOrder,
    MeshFacts,
    PlaceOrder,
    Plan,
    PlanOrder,
    WorkerError,
    WorkerProgress,
)
from gpis_grasp_planner.ros.worker.supervisor import START_LIMIT_S, WorkerSupervisor, WorkLimits

ACCEPT_LIMIT_S = 5.0
# It says every second that it is there; after this time it is stopped, or starved.
SILENCE_LIMIT_S = 5.0
# One that the system says is stopped has no excuse.
STOPPED_LIMIT_S = 2.0
# After a cancel: what is finished within this time is answered, else nothing.
CANCEL_WAIT_S = 0.2
_LOOK_S = 0.5
AnyOrder = PlanOrder | PlaceOrder | DescribeOrder
PREPARATION = (Phase.READING, Phase.PREPARING)


class _Lost(Exception):
    """The process died, or hung, with an order; `fault` is what to tell its caller."""

    def __init__(self, fault: GraspPlannerError) -> None:
        super().__init__(fault.message)
        self.fault = fault


@dataclass(eq=False)
class _LeftOver:
    """An order whose caller was answered, and which the process has not ended yet."""

    link: WorkerLink
    replies: Replies
    give_up_at: float


class PlanningProcess:
    """Has orders carried out; may be used from any thread, one at a time in each lane.

    Parameters
    ----------
    supervisor : WorkerSupervisor
    """

    def __init__(self, supervisor: WorkerSupervisor) -> None:
        self._supervisor = supervisor
        # Of each lane, used by whoever has its turn.
        self._left_over: dict[Lane, _LeftOver | None] = dict.fromkeys(Lane)

    def carry_out(self, order: PlanOrder | PlaceOrder, call: Call) -> Plan:
        """Have the worker carry out an order.

        Its time budget and the grace begin now; waiting for a worker that starts counts.

        Parameters
        ----------
        order : PlanOrder or PlaceOrder
        call : Call
            Told of the progress; where it is cancelled, the order is given up.

        Returns
        -------
        Plan
            With the code CANCELLED where a cancel left something that was finished.

        Raises
        ------
        SystemFault
            PLANNING_PROCESS_LOST if the worker died, SHUTTING_DOWN after the supervisor was closed.
        PlanningError
            DEADLINE_EXCEEDED if there was no answer in time, CANCELLED.
        GraspPlannerError
            What the planner itself raised, with its code.
        """
        plan = self._carried_out(order, call)
        assert isinstance(plan, Plan)
        return plan

    def describe(self, order: DescribeOrder, call: Call) -> MeshFacts:
        """Have a mesh read and described; raises as :meth:`carry_out`."""
        facts = self._carried_out(order, call)
        assert isinstance(facts, MeshFacts)
        return facts

    def _carried_out(self, order: AnyOrder, call: Call) -> Plan | MeshFacts:
        lane = Lane.SEARCH if isinstance(order, PlanOrder) else Lane.KNOWN
        limits, began, asked = self._supervisor.limits(), time.monotonic(), order.request
        for retries_left in range(limits.retries, -1, -1):
            call.check_wanted()
            order = _shortened(order, asked, time.monotonic() - began)
            deadline = time.monotonic() + order.request.time_budget_s + limits.grace_s
            self._finish_left_over(lane, call, deadline)
            try:
                link = self._ready_link(call, deadline)
                order = _shortened(order, asked, time.monotonic() - began)
                return self._attempt(link, order, lane, call, deadline, limits)
            except _Lost as lost:
                call.check_wanted()
                if not retries_left or lost.fault.code != ErrorCode.PLANNING_PROCESS_LOST:
                    raise lost.fault from None
                self._supervisor.on_event("Its order is given to the next process.")
        raise AssertionError("unreachable")

    def _attempt(
        self,
        link: WorkerLink,
        order: AnyOrder,
        lane: Lane,
        call: Call,
        deadline: float,
        limits: WorkLimits,
    ) -> Plan | MeshFacts:
        with self._supervisor.in_use(link):
            try:
                replies = link.send(order)
            except OSError as error:
                raise _Lost(self._supervisor.lost(link)) from error
            try:
                with call.woken_by(replies.interrupt):
                    return self._answer(order, lane, call, deadline, limits, link, replies)
            finally:
                left = self._left_over[lane]
                if left is None or left.replies is not replies:
                    replies.close()

    def _answer(
        self,
        order: AnyOrder,
        lane: Lane,
        call: Call,
        deadline: float,
        limits: WorkLimits,
        link: WorkerLink,
        replies: Replies,
    ) -> Plan | MeshFacts:
        sent = time.monotonic()
        phase: Phase | None = None
        accept_by, cancelled_by = sent + ACCEPT_LIMIT_S, math.inf
        while True:
            try:
                now = time.monotonic()
                message = replies.get(min(deadline, accept_by, cancelled_by, now + _LOOK_S) - now)
            except InterruptedError:
                replies.cancel()
                cancelled_by = min(cancelled_by, time.monotonic() + CANCEL_WAIT_S)
                continue
            except TimeoutError:
                prepares = phase is None or phase in PREPARATION
                patience_s = limits.preparation_s if prepares else limits.grace_s
                if time.monotonic() >= cancelled_by:
                    self._leave(lane, link, replies, time.monotonic() + patience_s)
                    call.check_wanted()
                if _hangs(link) or time.monotonic() >= accept_by:
                    raise _Lost(self._supervisor.lost(link)) from None
                if time.monotonic() < deadline:
                    continue
                prepares &= link.silent_s <= SILENCE_LIMIT_S
                replies.cancel()
                if prepares or lane is Lane.KNOWN:
                    self._leave(lane, link, replies, sent + patience_s)
                else:
                    self._supervisor.give_up(link)
                raise (_not_prepared if prepares else _late)(order, limits) from None
            except (EOFError, OSError) as error:
                raise _Lost(self._supervisor.lost(link)) from error
            if isinstance(message, Plan | MeshFacts):
                return message
            if isinstance(message, WorkerError):
                raise GraspPlannerError(message.message, message.code)
            accept_by = math.inf
            if isinstance(message, WorkerProgress):
                phase = message.progress.phase
                call.progress = message.progress

    def _leave(self, lane: Lane, link: WorkerLink, replies: Replies, give_up_at: float) -> None:
        """Let the process end an order that nobody waits for; it keeps what it has prepared."""
        self._supervisor.hold(link)
        self._left_over[lane] = _LeftOver(link, replies, give_up_at)

    def _finish_left_over(self, lane: Lane, call: Call, deadline: float) -> None:
        """Wait until the process has ended what was left in this lane, or give the process up."""
        left = self._left_over[lane]
        if left is None:
            return
        with call.woken_by(left.replies.interrupt):
            while self._supervisor.is_current(left.link):
                now = time.monotonic()
                if now >= left.give_up_at or left.link.silent_s > SILENCE_LIMIT_S:
                    self._supervisor.give_up(left.link)
                    break
                if now >= deadline:
                    raise PlanningError(
                        "The planning process still prepares a mesh for an earlier request. Call "
                        "again; mesh_preparation_limit_s limits that.",
                        ErrorCode.DEADLINE_EXCEEDED,
                    )
                try:
                    message = left.replies.get(min(_LOOK_S, deadline - now))
                except InterruptedError:
                    call.check_wanted()
                    continue
                except TimeoutError:
                    continue
                except (EOFError, OSError):
                    break
                if isinstance(message, Plan | MeshFacts | WorkerError):
                    break
        self._left_over[lane] = None
        left.replies.close()
        self._supervisor.release(left.link)

    def _ready_link(self, call: Call, deadline: float) -> WorkerLink:
        """The worker, once it takes orders."""
        failed = 0
        while True:
            link = self._supervisor.current()
            try:
                link.wait_ready(min(_LOOK_S / 10.0, max(deadline - time.monotonic(), 0.0)))
            except TimeoutError:
                call.check_wanted()
                if time.monotonic() - link.started_s > START_LIMIT_S:
                    self._supervisor.give_up(link)
                elif time.monotonic() >= deadline:
                    raise PlanningError(
                        f"The planning process has been starting for "
                        f"{time.monotonic() - link.started_s:.0f} s (up to two minutes where "
                        "it has to compile, once after an installation). Call again.",
                        ErrorCode.DEADLINE_EXCEEDED,
                    ) from None
            except EOFError:
                fault, failed = self._supervisor.lost(link), failed + 1
                if failed > 1 or fault.code != ErrorCode.PLANNING_PROCESS_LOST:
                    raise fault from None
            else:
                return link


def _shortened(order: AnyOrder, asked: PlanRequest, spent_s: float) -> AnyOrder:
    """The order with what is left of the time that was asked for; see `PlanRequest.again`."""
    return replace(order, request=asked.again(spent_s))


def _hangs(link: WorkerLink) -> bool:
    """Whether a process is stopped, by what the system says; a slow one is not."""
    return link.silent_s > STOPPED_LIMIT_S and link.stopped


def _late(order: AnyOrder, limits: WorkLimits) -> PlanningError:
    return PlanningError(
        f"There was no answer within the time budget of {order.request.time_budget_s:g} s and "
        f"{limits.grace_s:g} s of grace (parameter planning_grace_s). Try again, with fewer "
        "obstacles or uncertainty.samples, or a larger grace on a slow machine.",
        ErrorCode.DEADLINE_EXCEEDED,
    )


def _not_prepared(order: AnyOrder, limits: WorkLimits) -> PlanningError:
    return PlanningError(
        f"The mesh was not read and prepared within the time budget of "
        f"{order.request.time_budget_s:g} s and {limits.grace_s:g} s of grace (parameter "
        "planning_grace_s). That goes on and is kept: call again in a while.",
        ErrorCode.DEADLINE_EXCEEDED,
    )
