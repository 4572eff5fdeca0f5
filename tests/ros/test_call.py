"""A request on its way: cancelled once, by whoever is first, and everybody who waits is woken."""

from __future__ import annotations

import threading
import time

import pytest

from gpis_grasp_planner.errors import ErrorCode, PlanningError
from gpis_grasp_planner.ros.call import Call


def test_a_new_call_is_wanted_and_has_no_reason_or_progress() -> None:
    call = Call()
    call.check_wanted()
    assert not call.cancelled
    assert call.why_cancelled == ""
    assert call.progress is None
    assert not call.admitted


def test_the_first_reason_stays_and_is_what_is_raised() -> None:
    call = Call()
    call.cancel("The first.")
    call.cancel("The second.")
    assert call.cancelled
    assert call.why_cancelled == "The first."
    with pytest.raises(PlanningError, match=r"^The first\.$") as caught:
        call.check_wanted()
    assert caught.value.code is ErrorCode.CANCELLED


def test_a_cancel_wakes_each_that_waits_once_and_none_that_has_left() -> None:
    call, woken = Call(), []
    with call.woken_by(lambda: woken.append("left")):
        pass
    with call.woken_by(lambda: woken.append("outer")), call.woken_by(lambda: woken.append("inner")):
        assert woken == []
        call.cancel("Gone.")
        call.cancel("Gone.")
    assert sorted(woken) == ["inner", "outer"]


def test_who_begins_to_wait_after_the_cancel_is_woken_at_once() -> None:
    call, woken = Call(), []
    call.cancel("Gone.")
    with call.woken_by(lambda: woken.append("late")):
        assert woken == ["late"]


def test_an_error_inside_ends_the_waiting_as_well() -> None:
    call, woken = Call(), []
    with pytest.raises(KeyError), call.woken_by(lambda: woken.append("")):
        raise KeyError
    call.cancel("Gone.")
    assert woken == []


def test_the_same_function_may_wait_twice() -> None:
    call, woken = Call(), []

    def wake() -> None:
        woken.append("")

    with call.woken_by(wake):
        with call.woken_by(wake):
            pass
        call.cancel("Gone.")
    assert woken == [""]


def test_of_many_threads_that_cancel_at_once_one_gives_the_reason_and_wakes() -> None:
    for _ in range(50):
        call, woken, together = Call(), [], threading.Barrier(8)

        def cancel(k: int, call: Call = call, together: threading.Barrier = together) -> None:
            together.wait()
            call.cancel(str(k))

        threads = [threading.Thread(target=cancel, args=(k,)) for k in range(8)]
        with call.woken_by(lambda woken=woken, call=call: woken.append(call.why_cancelled)):
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        assert woken == [call.why_cancelled]


def test_the_time_is_counted_from_when_it_came() -> None:
    before = time.monotonic()
    call = Call()
    after = time.monotonic()
    assert before <= call.start <= after
    low = time.monotonic() - after
    assert low <= call.elapsed_s <= time.monotonic() - before
