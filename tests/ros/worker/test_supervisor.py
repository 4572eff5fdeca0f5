"""The owner of real planning processes: one at a time, replaced where it is gone, hung or large."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from gpis_grasp_planner.errors import ErrorCode, SystemFault
from gpis_grasp_planner.ros.worker import supervisor as module
from gpis_grasp_planner.ros.worker.link import WorkerLink
from gpis_grasp_planner.ros.worker.supervisor import WorkerSupervisor, WorkLimits

LIMIT_S = 180.0
LIMITS = WorkLimits(grace_s=1.0, preparation_s=1.0)


class Supervised(WorkerSupervisor):
    """One whose limits a test changes, and whose events it reads."""

    def __init__(self) -> None:
        self.now = LIMITS
        self.events: list[str] = []
        super().__init__(lambda: self.now, self.events.append)


@pytest.fixture
def supervisor() -> Iterator[Supervised]:
    made = Supervised()
    yield made
    made.close()


def wait_for(condition: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.01)


def gone(pid: int) -> bool:
    return not Path(f"/proc/{pid}").exists()


def test_there_is_none_before_it_is_asked_for(supervisor: Supervised) -> None:
    assert supervisor.pid is None
    assert not supervisor.ready
    assert supervisor.memory_bytes == 0
    assert supervisor.starts == 0


def test_it_is_started_once_however_often_that_is_asked(supervisor: Supervised) -> None:
    supervisor.ensure_started()
    pid = supervisor.pid
    supervisor.ensure_started()
    supervisor.revive()
    link = supervisor.current()
    assert (supervisor.pid, link.pid, supervisor.starts) == (pid, pid, 1)
    assert supervisor.is_current(link)
    assert supervisor.events == []
    link.wait_ready(LIMIT_S)
    assert supervisor.ready
    assert supervisor.memory_bytes > 20e6


def test_one_that_died_while_idle_is_told_and_followed_by_another(supervisor: Supervised) -> None:
    first = supervisor.current()
    os.kill(first.pid, signal.SIGKILL)
    wait_for(lambda: not first.running, "it is gone")
    assert supervisor.pid is None
    second = supervisor.current()
    assert second.pid != first.pid
    assert supervisor.starts == 2
    assert supervisor.events == [
        f"The planning process {first.pid} was gone (it was ended by SIGKILL); starting another."
    ]


def test_a_revival_waits_for_its_period(
    supervisor: Supervised, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = supervisor.current()
    first.end()
    supervisor.revive()
    assert supervisor.pid is None
    monkeypatch.setattr(module, "REVIVAL_PERIOD_S", 0.0)
    supervisor.revive()
    assert supervisor.pid is not None


def test_who_loses_an_order_is_told_how_and_the_first_one_reports(supervisor: Supervised) -> None:
    first = supervisor.current()
    os.kill(first.pid, signal.SIGSEGV)
    faults = [supervisor.lost(first) for _ in range(2)]
    for fault in faults:
        assert fault.code is ErrorCode.PLANNING_PROCESS_LOST
        assert first.how_it_ended() in fault.message
    assert len(supervisor.events) == 1
    assert supervisor.starts == 2
    assert not supervisor.is_current(first)
    assert not first.running


def test_giving_up_ends_it_and_starts_another(supervisor: Supervised) -> None:
    first = supervisor.current()
    supervisor.give_up(first)
    assert not first.running
    assert supervisor.pid not in (None, first.pid)
    assert supervisor.events == [f"Giving up the planning process {first.pid}."]
    supervisor.give_up(first)  # somebody else had the same thought
    assert len(supervisor.events) == 1
    assert supervisor.starts == 2


def test_after_the_end_there_is_none_and_nothing_starts(supervisor: Supervised) -> None:
    link = supervisor.current()
    supervisor.close()
    supervisor.close()
    assert gone(link.pid) or not link.running
    with pytest.raises(SystemFault, match="shutting down") as caught:
        supervisor.current()
    assert caught.value.code is ErrorCode.SHUTTING_DOWN
    assert supervisor.lost(link).code is ErrorCode.SHUTTING_DOWN
    supervisor.give_up(link)
    supervisor.ensure_started()
    assert supervisor.pid is None
    assert supervisor.starts == 1


def used(supervisor: Supervised, link: WorkerLink) -> None:
    with supervisor.in_use(link):
        pass


def test_one_that_has_grown_is_replaced_between_two_orders(supervisor: Supervised) -> None:
    first = supervisor.current()
    first.wait_ready(LIMIT_S)
    used(supervisor, first)
    assert supervisor.is_current(first)  # no limit
    supervisor.now = replace(LIMITS, memory_bytes=1.0)
    used(supervisor, first)
    supervisor.now = LIMITS
    assert supervisor.is_current(first)  # it works until the other is ready
    assert first.running
    wait_for(lambda: not supervisor.is_current(first), "it was replaced")
    assert supervisor.ready
    wait_for(lambda: not first.running, "it was ended")
    assert supervisor.starts == 2
    wait_for(lambda: bool(supervisor.events), "it is told")
    [event] = supervisor.events
    assert f"{first.pid} had grown to" in event
    assert f"replaced by {supervisor.pid}" in event


def test_one_that_is_replaced_ends_after_its_last_order(supervisor: Supervised) -> None:
    first = supervisor.current()
    first.wait_ready(LIMIT_S)
    supervisor.hold(first)
    supervisor.now = replace(LIMITS, memory_bytes=1.0)
    used(supervisor, first)
    supervisor.now = LIMITS
    wait_for(lambda: not supervisor.is_current(first), "it was replaced")
    assert first.running
    supervisor.release(first)
    assert not first.running
    assert supervisor.ready


def test_one_that_is_closed_while_it_is_replaced_leaves_no_process(supervisor: Supervised) -> None:
    first = supervisor.current()
    first.wait_ready(LIMIT_S)
    supervisor.now = replace(LIMITS, memory_bytes=1.0)
    used(supervisor, first)
    supervisor.close()
    wait_for(lambda: not supervisor._replacing, "the replacement was given up")
    children = [
        pid
        for task in Path("/proc/self/task").iterdir()
        for pid in (task / "children").read_text().split()
        if "worker.main" in Path(f"/proc/{pid}/cmdline").read_text()
    ]
    assert children == []
