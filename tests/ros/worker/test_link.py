"""One real planning process and its socket pair: numbers, ends, interruptions, signals."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.ros.parameter_groups import parameter_groups
from gpis_grasp_planner.ros.worker.link import Replies, WorkerLink
from gpis_grasp_planner.ros.worker.messages import (
    DescribeOrder,
    MeshFacts,
    WorkerAccepted,
    WorkerError,
    WorkerProgress,
)

LIMIT_S = 180.0
VALUES = {name: kind().as_dict() for name, kind in parameter_groups().items() if name}


def order(mesh_id: str) -> DescribeOrder:
    folder = str(default_catalogue_directory())
    return DescribeOrder(mesh_id, (folder,), PlanRequest(), VALUES)


def answer(replies: Replies) -> object:
    """The last message to an order; the first one says that it was accepted."""
    assert isinstance(replies.get(LIMIT_S), WorkerAccepted)
    while isinstance(message := replies.get(LIMIT_S), WorkerProgress):
        pass
    replies.close()
    return message


def wait_for(condition: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.01)


@pytest.fixture(scope="module")
def link() -> Iterator[WorkerLink]:
    made = WorkerLink(nice=3)
    made.wait_ready(LIMIT_S)
    yield made
    made.end()


@pytest.fixture
def own_link() -> Iterator[WorkerLink]:
    """One that a test may end; it need not be ready."""
    made = WorkerLink()
    yield made
    made.end()


def test_it_is_another_process_that_runs_and_is_nicer(link: WorkerLink) -> None:
    assert link.running
    assert link.ready
    assert Path(f"/proc/{link.pid}/status").read_text().split("PPid:\t")[1].split()[0] == str(
        os.getpid()
    )
    own = os.getpriority(os.PRIO_PROCESS, 0)
    assert os.getpriority(os.PRIO_PROCESS, link.pid) == min(own + 3, 19)
    assert os.getsid(link.pid) == link.pid  # a Ctrl-C in the terminal is not for it


def test_an_order_is_accepted_and_answered(link: WorkerLink) -> None:
    facts = answer(link.send(order("mug")))
    part = MeshCatalogue((default_catalogue_directory(),)).load("mug")
    assert isinstance(facts, MeshFacts)
    assert facts.size == pytest.approx(tuple(part.mesh.extent))
    assert facts.mass == pytest.approx(part.mass)


def test_each_of_many_orders_gets_its_own_answer(link: WorkerLink) -> None:
    names = ["mug", "sphere", "no-such-part", "mug", "flask", "sphere"]
    boxes = [link.send(order(name)) for name in names]
    answers = dict(zip(names, [answer(box) for box in boxes], strict=False))
    again = [answer(link.send(order(name))) for name in names]
    assert [answers[name] for name in names] == again
    refused = answers.pop("no-such-part")
    assert isinstance(refused, WorkerError)
    assert refused.code == ErrorCode.UNKNOWN_MESH
    assert "no-such-part" in refused.message
    assert len({facts.size for facts in answers.values() if isinstance(facts, MeshFacts)}) == 3


def test_after_close_nothing_is_delivered_and_nothing_kept(link: WorkerLink) -> None:
    closed = link.send(order("mug"))
    closed.close()
    closed.close()
    assert isinstance(answer(link.send(order("sphere"))), MeshFacts)
    while not closed.messages.empty():  # what came before it was closed
        closed.get(0.0)
    assert isinstance(answer(link.send(order("sphere"))), MeshFacts)
    with pytest.raises(TimeoutError, match=r"no message within 0\.1 s"):
        closed.get(0.1)
    assert link._boxes == {}


def test_a_message_that_cannot_be_sent_leaves_no_mailbox(link: WorkerLink) -> None:
    with pytest.raises(Exception, match="pickle"):
        link.send(lambda: None)
    assert link._boxes == {}
    assert link.ready


def test_an_interruption_wakes_once_and_loses_no_message(link: WorkerLink) -> None:
    replies = link.send(order("mug"))
    replies.interrupt()
    seen: list[object] = []
    # On a busy machine the answer may be there before the interruption is.
    while "interrupted" not in seen or not any(isinstance(m, MeshFacts) for m in seen):
        try:
            seen.append(replies.get(LIMIT_S))
        except InterruptedError:
            seen.append("interrupted")
    replies.close()
    assert seen.count("interrupted") == 1
    seen.remove("interrupted")
    assert isinstance(seen[0], WorkerAccepted)
    assert all(isinstance(m, WorkerProgress) for m in seen[1:-1])


def test_a_cancel_of_what_was_answered_or_never_sent_does_no_harm(link: WorkerLink) -> None:
    replies = link.send(order("mug"))
    assert isinstance(answer(replies), MeshFacts)
    replies.cancel()
    link.cancel(10**9)
    assert isinstance(answer(link.send(order("mug"))), MeshFacts)


def test_its_memory_is_what_is_private_to_it(link: WorkerLink) -> None:
    pages = [int(n) for n in Path(f"/proc/{link.pid}/statm").read_text().split()]
    size = os.sysconf("SC_PAGE_SIZE")
    assert link.resident_bytes() == pytest.approx((pages[1] - pages[2]) * size, rel=0.2)
    assert 20e6 < link.resident_bytes() < 2e9


def test_it_is_heard_every_second_unless_stopped(link: WorkerLink) -> None:
    wait_for(lambda: link.silent_s > 0.3, "it is never silent for a third of a second")
    heard = link.heard_s
    wait_for(lambda: link.heard_s > heard, "nothing is heard")
    assert not link.stopped
    os.kill(link.pid, signal.SIGSTOP)
    try:
        wait_for(lambda: link.stopped, "it was stopped")
        wait_for(lambda: link.silent_s > 2.0, "it is silent")
    finally:
        os.kill(link.pid, signal.SIGCONT)
    wait_for(lambda: link.silent_s < 2.0, "it is heard again")
    assert not link.stopped


def test_one_that_still_starts_is_waited_for_until_the_limit(own_link: WorkerLink) -> None:
    with pytest.raises(TimeoutError, match=r"not ready within 0\.01 s"):
        own_link.wait_ready(0.01)
    assert own_link.running
    assert not own_link.ready


def test_the_end_is_told_to_all_that_wait_and_to_whoever_comes_later(own_link: WorkerLink) -> None:
    waiting = [own_link.send(order("mug")) for _ in range(2)]
    os.kill(own_link.pid, signal.SIGKILL)
    for replies in waiting:
        for _ in range(2):  # however often one asks
            with pytest.raises(EOFError):
                replies.get(LIMIT_S)
    with pytest.raises(EOFError):
        own_link.wait_ready(LIMIT_S)
    own_link.end()
    assert not own_link.running
    assert not own_link.ready
    assert own_link.how_it_ended() == "it was ended by SIGKILL"
    with pytest.raises(OSError):  # noqa: PT011  # closed or broken, by who was first
        own_link.send(order("mug"))
    assert own_link.resident_bytes() == 0
    own_link.end()


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0, "it ended with exit code 0"),
        (3, "it ended with exit code 3"),
        (-signal.SIGSEGV, "it was ended by SIGSEGV"),
        (-77, "it was ended by signal 77"),
    ],
)
def test_how_it_ended_in_words(own_link: WorkerLink, code: int, words: str) -> None:
    own_link.end()
    own_link._process.returncode = code
    assert own_link.how_it_ended() == words


def test_an_end_also_ends_a_stopped_process(own_link: WorkerLink) -> None:
    os.kill(own_link.pid, signal.SIGSTOP)
    own_link.end()
    assert not own_link.running
