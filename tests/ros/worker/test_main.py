"""The planning process itself: its inbox on a real pair of sockets, its life with the node's."""

from __future__ import annotations

import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import pytest

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.plan.progress import Phase, Progress
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.ros.worker.main import OrderInbox
from gpis_grasp_planner.ros.worker.messages import (
    CancelOrder,
    DescribeOrder,
    MeshFacts,
    PlanOrder,
    WorkerAccepted,
    WorkerAlive,
    WorkerError,
    WorkerProgress,
)

LIMIT_S = 180.0
FACTS = MeshFacts((0.1, 0.2, 0.3), 0.4)
PROGRESS = Progress(Phase.READING, 0.5, 2.0)


def describe(mesh_id: str = "mug") -> DescribeOrder:
    return DescribeOrder(mesh_id, (), PlanRequest(), {})


def make(mesh_id: str = "mug") -> PlanOrder:
    return PlanOrder(mesh_id, (), PlanRequest(), {})


@dataclass
class Pair:
    """An inbox that threads serve, and the node's end of its pair."""

    node: Connection
    inbox: OrderInbox

    def serve(self, orders: Any, carry_out: Callable[..., Any]) -> None:
        threading.Thread(target=self.inbox.serve, args=(orders, carry_out), daemon=True).start()

    def hear(self) -> Any:
        assert self.node.poll(LIMIT_S)
        return self.node.recv()


@pytest.fixture
def pair() -> Pair:
    """The node's end stays open: its closing would end this process."""
    node, theirs = Pipe()
    inbox = OrderInbox(theirs)
    threading.Thread(target=inbox.receive, daemon=True).start()
    KEPT.append(node)
    return Pair(node, inbox)


KEPT: list[Connection] = []


def test_an_order_is_accepted_reported_on_and_answered_under_its_number(pair: Pair) -> None:
    def carry_out(order: Any, report: Callable[[Progress], None], stop: Any) -> MeshFacts:
        assert order.mesh_id == "mug"
        assert not stop()
        report(PROGRESS)
        return FACTS

    pair.serve(pair.inbox.places, carry_out)
    pair.node.send((7, describe()))
    heard = [pair.hear() for _ in range(3)]
    assert [number for number, _ in heard] == [7, 7, 7]
    assert isinstance(heard[0][1], WorkerAccepted)
    assert heard[1][1] == WorkerProgress(PROGRESS)
    assert heard[2][1] == FACTS


def test_plans_and_the_rest_wait_in_queues_of_their_own_in_their_order(pair: Pair) -> None:
    for number, order in enumerate([make("a"), describe("b"), make("c"), describe("d")]):
        pair.node.send((number, order))
    plans = [pair.inbox.plans.get(timeout=LIMIT_S) for _ in range(2)]
    places = [pair.inbox.places.get(timeout=LIMIT_S) for _ in range(2)]
    assert [(n, o.mesh_id) for n, o in plans] == [(0, "a"), (2, "c")]
    assert [(n, o.mesh_id) for n, o in places] == [(1, "b"), (3, "d")]


def test_what_is_known_is_answered_while_a_plan_is_made(pair: Pair) -> None:
    let_go: queue.SimpleQueue[None] = queue.SimpleQueue()

    def slow(*_: Any) -> MeshFacts:
        let_go.get(timeout=LIMIT_S)
        return FACTS

    pair.serve(pair.inbox.plans, slow)
    pair.serve(pair.inbox.places, lambda *_: FACTS)
    pair.node.send((1, make()))
    assert pair.hear() == (1, WorkerAccepted())
    pair.node.send((2, describe()))
    assert [pair.hear(), pair.hear()] == [(2, WorkerAccepted()), (2, FACTS)]
    let_go.put(None)
    assert pair.hear() == (1, FACTS)


def test_a_cancel_reaches_the_order_of_its_number_alone(pair: Pair) -> None:
    begun: queue.SimpleQueue[None] = queue.SimpleQueue()

    def until_stopped(_order: Any, _report: Any, stop: Callable[[], bool]) -> MeshFacts:
        begun.put(None)
        deadline = time.monotonic() + LIMIT_S
        while not stop():
            assert time.monotonic() < deadline
            time.sleep(0.002)
        return FACTS

    pair.serve(pair.inbox.places, until_stopped)
    pair.node.send((1, describe()))
    pair.node.send((2, describe()))
    begun.get(timeout=LIMIT_S)
    pair.node.send((99, CancelOrder()))  # unknown, or answered meanwhile
    pair.node.send((2, CancelOrder()))  # waits still: it stops as soon as it begins
    pair.node.send((1, CancelOrder()))
    heard = [pair.hear() for _ in range(4)]
    assert [number for number, _ in heard] == [1, 1, 2, 2]
    assert heard[1][1] == heard[3][1] == FACTS
    assert pair.inbox._unwanted == {}


@pytest.mark.parametrize(
    ("raised", "code", "says"),
    [
        (MeshError("Its faces are gone."), MeshError("").code, "Its faces are gone."),
        (MemoryError(), ErrorCode.OUT_OF_MEMORY, "memory"),
        (ZeroDivisionError(), ErrorCode.INTERNAL, "ZeroDivisionError"),
    ],
)
def test_an_order_that_fails_is_answered_and_the_next_one_too(
    pair: Pair, raised: Exception, code: ErrorCode, says: str
) -> None:
    def carry_out(order: Any, *_: Any) -> MeshFacts:
        if order.mesh_id == "bad":
            raise raised
        return FACTS

    pair.serve(pair.inbox.places, carry_out)
    pair.node.send((1, describe("bad")))
    pair.node.send((2, describe("good")))
    assert pair.hear() == (1, WorkerAccepted())
    number, error = pair.hear()
    assert (number, type(error), error.code) == (1, WorkerError, code)
    assert says in error.message
    assert [pair.hear(), pair.hear()] == [(2, WorkerAccepted()), (2, FACTS)]


def test_it_says_that_it_is_there_and_ends_silently_without_a_node() -> None:
    node, theirs = Pipe()
    thread = threading.Thread(target=OrderInbox(theirs).say_alive, daemon=True)
    thread.start()
    assert node.poll(LIMIT_S)
    assert node.recv() == (0, WorkerAlive())
    node.close()
    thread.join(LIMIT_S)
    assert not thread.is_alive()


RECEIVER = """
import sys, threading, time
from multiprocessing.connection import Connection
from gpis_grasp_planner.ros.worker.main import OrderInbox
inbox = OrderInbox(Connection(int(sys.argv[1])))
threading.Thread(target=inbox.receive, daemon=True).start()
print("ready", flush=True)
while True:
    time.sleep(1.0)
"""


def test_the_process_ends_in_the_middle_of_its_work_when_the_node_closes_the_pair() -> None:
    node, theirs = Pipe()
    command = [sys.executable, "-c", RECEIVER, str(theirs.fileno())]
    with subprocess.Popen(command, pass_fds=[theirs.fileno()], stdout=subprocess.PIPE) as child:
        theirs.close()
        assert child.stdout is not None
        assert child.stdout.readline() == b"ready\n"
        assert child.poll() is None
        node.close()
        assert child.wait(LIMIT_S) == 0


PARENT = """
import os, subprocess, sys, time
child = subprocess.Popen([sys.executable, "-c", '''
import sys, time
from gpis_grasp_planner.ros.worker.main import end_with_parent
end_with_parent(int(sys.argv[1]))
print("ready", flush=True)
time.sleep(600)
''', str(os.getpid())], stdout=subprocess.PIPE)
child.stdout.readline()
print(child.pid, flush=True)
time.sleep(600)
"""


@pytest.mark.parametrize("stopped", [False, True])
def test_the_process_ends_with_its_parent_even_where_it_is_stopped(stopped: bool) -> None:
    with subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        if stopped:
            os.kill(pid, signal.SIGSTOP)
        parent.kill()
        parent.wait()
    deadline = time.monotonic() + LIMIT_S
    while alive(pid):
        assert time.monotonic() < deadline, "it outlives its parent"
        time.sleep(0.01)


def alive(pid: int) -> bool:
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return stat.rpartition(") ")[2][:1] != "Z"  # who inherits it may take its time


def test_a_process_whose_parent_went_before_it_asked_ends_at_once() -> None:
    code = "from gpis_grasp_planner.ros.worker.main import end_with_parent as e; e(1); print('on')"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=LIMIT_S)
    assert (ended.returncode, ended.stdout) == (0, b"")
