"""Calls whose clients are gone."""

from __future__ import annotations

import pytest

from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.client_watch import ClientWatch


@pytest.mark.parametrize(
    ("counts", "cancelled"),
    [
        ([1, 1, 1, 1], False),
        ([1, 0, 0], True),
        ([1, 0, 1, 0], False),  # only for a moment
        ([0, 0, 0, 0], False),  # the middleware has not learned of the client yet
        ([0, 0, 1, 0], False),
        ([0, 0, 1, 0, 0], True),
    ],
)
def test_a_call_is_cancelled_where_its_clients_were_seen_and_are_gone(
    counts: list[int], cancelled: bool
) -> None:
    coming = iter(counts)
    watch, call = ClientWatch(lambda: next(coming)), Call()
    with watch.watched(call):
        for _ in counts:
            watch.look()
        assert call.cancelled == cancelled


def test_a_call_that_came_after_the_others_had_gone_is_left_alone() -> None:
    count = 1
    watch, first, second = ClientWatch(lambda: count), Call(), Call()
    with watch.watched(first):
        watch.look()
        count = 0
        watch.look()
        with watch.watched(second):
            watch.look()
            assert first.cancelled
            assert not second.cancelled


def test_without_calls_nobody_is_counted() -> None:
    watch = ClientWatch(lambda: 1 // 0)
    watch.look()
    with watch.watched(Call()):
        pass
    watch.look()
