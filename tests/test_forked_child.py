"""Forked children: they answer, keep nothing of the parent open, and end when told."""

from __future__ import annotations

import os
import signal
import time
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from gpis_grasp_planner.errors import SystemFault
from gpis_grasp_planner.forked_child import (
    ForkedChild,
    answer_requests,
    share_out,
    usable_cores,
)


def test_a_child_answers_with_what_it_inherited() -> None:
    table = {n: n * n for n in range(100)}
    with ForkedChild(partial(answer_requests, table.__getitem__)) as child:
        for n in (3, 99):
            child.connection.send(n)
            assert child.connection.recv() == n * n


def test_an_exception_in_a_child_is_an_end_of_file(capfd: pytest.CaptureFixture[str]) -> None:
    with ForkedChild(partial(answer_requests, {}.__getitem__)) as child:
        child.connection.send("not there")
        with pytest.raises(EOFError):
            child.connection.recv()
    assert capfd.readouterr() == ("", "")


def test_a_child_holds_no_file_of_the_parent() -> None:
    reading, writing = os.pipe()
    with ForkedChild(partial(answer_requests, str)) as child:
        child.connection.send(1)
        assert child.connection.recv() == "1"
        os.close(writing)
        # a copy of the writing end in the child would make this wait for ever
        assert os.read(reading, 1) == b""
    os.close(reading)


def test_a_child_that_is_ended_is_gone() -> None:
    def work(connection: Connection) -> None:
        connection.send(os.getpid())
        time.sleep(600.0)

    child = ForkedChild(work)
    pid = child.connection.recv()
    child.end()
    child.end()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_usable_cores_are_those_of_the_affinity() -> None:
    assert usable_cores() == len(os.sched_getaffinity(0))


def test_requests_are_shared_out_and_answered_in_their_order() -> None:
    def serve(connection: Connection) -> None:
        answer_requests(lambda n: (n * n, os.getpid()), connection)

    answers = share_out(serve, range(7), processes=3)
    assert [square for square, _ in answers] == [n * n for n in range(7)]
    assert os.getpid() not in {pid for _, pid in answers}
    assert len({pid for _, pid in answers}) <= 3
    assert share_out(serve, [], processes=2) == []


def test_a_free_child_takes_the_next_request(tmp_path: Path) -> None:
    """The first request is answered only after all others: one child answers them all."""
    done = tmp_path / "done"
    os.mkfifo(done)

    def answer(n: int) -> int:
        if n in (0, 4):  # whoever opens the pipe waits for the other end
            done.open("r" if n == 0 else "w").close()
        return os.getpid()

    pids = share_out(partial(answer_requests, answer), range(5), processes=2)
    assert len(set(pids[1:])) == 1
    assert pids[0] != pids[1]


def test_a_child_that_dies_is_a_clear_fault() -> None:
    def answer(n: int) -> int:
        if n == 2:
            os.kill(os.getpid(), signal.SIGKILL)
        return n

    with pytest.raises(SystemFault, match=r"code -9.*request 3 of 4"):
        share_out(partial(answer_requests, answer), range(4), processes=2)


def test_an_answered_exception_is_raised() -> None:
    with pytest.raises(ZeroDivisionError, match="by nothing"):
        share_out(
            partial(answer_requests, lambda _: ZeroDivisionError("by nothing")), [1], processes=1
        )


def test_a_child_ends_with_its_parent() -> None:
    reading, writing = os.pipe()
    parent = os.fork()
    if parent == 0:
        own = ForkedChild(lambda _: time.sleep(600.0))
        os.write(writing, str(own.pid).encode())
        time.sleep(600.0)
    child = int(os.read(reading, 20))
    assert is_running(child)
    os.kill(parent, signal.SIGKILL)
    os.waitpid(parent, 0)
    limit = time.monotonic() + 20.0
    while is_running(child) and time.monotonic() < limit:
        time.sleep(0.01)
    assert not is_running(child)
    os.close(reading)
    os.close(writing)


def is_running(pid: int) -> bool:
    """Whether a process runs; one that waits to be reaped does not."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except FileNotFoundError:
        return False
    return stat.rpartition(")")[2].split()[0] != "Z"
