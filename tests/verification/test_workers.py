"""Forked children: they answer, keep nothing of the parent open, and end when told."""

from __future__ import annotations

import os
import time
from functools import partial
from multiprocessing.connection import Connection

import pytest

from gpis_grasp_planner.verification.workers import ForkedChild, answer_requests, usable_cores


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
