"""The queue of the planning process: order, bound, two lanes, cancelled requests."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError
from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.work_queue import Lane, WorkQueue

LIMIT_S = 20.0


class Holder:
    """Takes a turn in a thread, says when it has it, and holds it until it is let go."""

    def __init__(self, queue: WorkQueue, lane: Lane, log: list[int], number: int) -> None:
        self.call, self.code = Call(), None
        self.has_it, self.let_go = threading.Event(), threading.Event()
        self._arguments = queue, lane, log, number
        self.thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        queue, lane, log, number = self._arguments
        try:
            with queue.turn(lane, self.call):
                log.append(number)
                self.has_it.set()
                assert self.let_go.wait(LIMIT_S)
        except GraspPlannerError as error:
            self.code = error.code

    def start(self, wait: Any) -> Holder:
        queue = self._arguments[0]
        before = queue.n_waiting + queue.n_running
        self.thread.start()
        wait(lambda: queue.n_waiting + queue.n_running > before or not self.thread.is_alive())
        return self

    def end(self) -> None:
        self.let_go.set()
        self.thread.join(LIMIT_S)
        assert not self.thread.is_alive()


@pytest.fixture
def until(tools: Any) -> Any:
    return lambda condition: tools.wait(condition, "the queue")


def test_turns_come_in_order_and_one_at_a_time(until: Any) -> None:
    queue, log = WorkQueue(lambda: 10), list[int]()
    holders = [Holder(queue, Lane.SEARCH, log, n).start(until) for n in range(6)]
    assert (queue.n_running, queue.n_waiting) == (1, 5)
    for n, holder in enumerate(holders):
        assert holder.has_it.wait(LIMIT_S)
        assert log == list(range(n + 1))
        holder.end()
    assert (queue.n_running, queue.n_waiting) == (0, 0)


def test_the_bound_counts_what_waits_in_both_lanes(until: Any) -> None:
    queue, log = WorkQueue(lambda: 2), list[int]()
    lanes = (Lane.SEARCH, Lane.KNOWN, Lane.SEARCH, Lane.KNOWN)
    holders = [Holder(queue, lane, log, n).start(until) for n, lane in enumerate(lanes)]
    assert sorted(log) == [0, 1]
    for lane in Lane:
        with pytest.raises(GraspPlannerError, match="2 requests wait; the limit is 2") as caught:
            queue.turn(lane, Call()).__enter__()
        assert caught.value.code == ErrorCode.BUSY
    for holder in holders:
        holder.end()
    assert sorted(log) == [0, 1, 2, 3]
    assert all(holder.code is None for holder in holders)


def test_a_free_lane_is_used_even_with_a_queue_of_none(until: Any) -> None:
    queue, log = WorkQueue(lambda: 0), list[int]()
    search = Holder(queue, Lane.SEARCH, log, 0).start(until)
    with queue.turn(Lane.KNOWN, Call()):
        assert queue.n_running == 2
    with pytest.raises(GraspPlannerError):
        queue.turn(Lane.SEARCH, Call()).__enter__()
    search.end()
    with queue.turn(Lane.SEARCH, Call()):
        pass


def test_who_was_admitted_before_waits_beyond_the_bound(until: Any) -> None:
    queue, log = WorkQueue(lambda: 0), list[int]()
    search = Holder(queue, Lane.SEARCH, log, 0).start(until)
    passed, call = threading.Event(), Call()
    with queue.turn(Lane.KNOWN, call):
        pass

    def again() -> None:
        with queue.turn(Lane.SEARCH, call):
            passed.set()

    thread = threading.Thread(target=again)
    thread.start()
    until(lambda: queue.n_waiting == 1)
    assert not passed.is_set()
    search.end()
    thread.join(LIMIT_S)
    assert passed.is_set()


def test_a_cancelled_request_leaves_the_queue_at_once_and_is_not_worked_on(until: Any) -> None:
    queue, log = WorkQueue(lambda: 5), list[int]()
    holders = [Holder(queue, Lane.SEARCH, log, n).start(until) for n in range(3)]
    holders[1].call.cancel("Cancelled by its client.")
    holders[1].thread.join(LIMIT_S)
    assert holders[1].code == ErrorCode.CANCELLED
    assert queue.n_waiting == 1
    for holder in (holders[0], holders[2]):
        holder.end()
    assert log == [0, 2]


def test_what_fails_in_its_turn_frees_the_lane() -> None:
    queue = WorkQueue(lambda: 0)
    with pytest.raises(ZeroDivisionError), queue.turn(Lane.SEARCH, Call()):
        raise ZeroDivisionError
    with queue.turn(Lane.SEARCH, Call()):
        assert queue.n_running == 1


def test_a_call_keeps_the_first_reason_and_wakes_who_comes_later() -> None:
    call, woken = Call(), list[int]()
    call.check_wanted()
    call.cancel("first")
    call.cancel("second")
    with call.woken_by(lambda: woken.append(1)):
        assert woken == [1]
    with pytest.raises(GraspPlannerError, match="first") as caught:
        call.check_wanted()
    assert caught.value.code == ErrorCode.CANCELLED


def reserved(queue: WorkQueue, n: int) -> list[Call]:
    calls = [Call() for _ in range(n)]
    for call in calls:
        queue.reserve(call)
    return calls


@pytest.mark.parametrize("size", [0, 3])
def test_as_many_places_are_kept_as_may_wait_and_one_where_nobody_searches(
    until: Any, size: int
) -> None:
    queue, log = WorkQueue(lambda: size), list[int]()
    calls = reserved(queue, size + 1)
    with pytest.raises(GraspPlannerError) as caught:
        queue.reserve(Call())
    assert caught.value.code == ErrorCode.BUSY
    assert f"the limit is {size} (parameter queue_size)" in caught.value.message
    queue.release(calls[0])
    queue.release(calls[0])
    search = Holder(queue, Lane.SEARCH, log, 0).start(until)  # has the free lane
    with pytest.raises(GraspPlannerError):
        queue.reserve(Call())
    search.end()
    reserved(queue, 1)


def test_a_kept_place_is_used_by_the_first_turn_however_many_wait(until: Any) -> None:
    size = 2
    queue, log = WorkQueue(lambda: size), list[int]()
    search = Holder(queue, Lane.SEARCH, log, 0).start(until)
    kept = [Holder(queue, Lane.SEARCH, log, n) for n in (1, 2)]
    for holder in kept:
        queue.reserve(holder.call)
    with pytest.raises(GraspPlannerError), queue.turn(Lane.SEARCH, Call()):
        raise AssertionError("beyond the bound")
    for holder in kept:
        holder.start(until)
    assert queue.n_waiting == size
    with pytest.raises(GraspPlannerError):
        queue.reserve(Call())
    for holder in (search, *kept):
        holder.end()
    assert log == [0, 1, 2]
    assert len(reserved(queue, size + 1)) == size + 1
