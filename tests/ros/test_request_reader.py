"""Requests over real DDS: all are read, at once, each gets its own answer; an end is an end."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import pytest
from rclpy.node import Node
from rclpy.qos import QoSProfile
from real_node import plain_node

from gpis_grasp_msgs.srv import ListMeshes, PlanGrasp
from gpis_grasp_planner.ros.request_reader import RequestReader, later

MANY = 60  # the middleware's default history keeps 10
LIMIT_S = 30.0


@dataclass
class Served:
    """A reader on a node that nobody spins, with two services; answers wait where a test says."""

    server: Node
    client: Node
    reader: RequestReader
    threads: ThreadPoolExecutor
    begun: list[str] = field(default_factory=list)
    let_go: threading.Event = field(default_factory=threading.Event)

    def begin(self, request: Any, response: Any) -> Any:
        if request.mesh_id == "cannot begin":
            raise ValueError("a beginning that failed")
        if request.mesh_id.startswith("at once"):
            response.message = threading.current_thread().name
            return None
        return partial(self.plan, request, response)

    def plan(self, request: Any, response: Any) -> None:
        self.begun.append(request.mesh_id)
        if request.mesh_id == "fails":
            raise ValueError("an answer that failed")
        if request.mesh_id.startswith("waits"):
            assert self.let_go.wait(LIMIT_S)
        response.message = f"answer to {request.mesh_id}"

    def call(self, client: Any, mesh_id: str) -> Any:
        return client.call_async(PlanGrasp.Request(mesh_id=mesh_id))


@pytest.fixture
def served() -> Iterator[Served]:
    with plain_node("server") as server, plain_node("client", spins=True) as client:
        threads = ThreadPoolExecutor(8)
        made = Served(server, client, RequestReader(server, threads), threads)
        made.reader.offer(PlanGrasp, "plan", made.begin)
        made.reader.offer(ListMeshes, "list", later(lambda _request, _response: None))
        yield made
        made.let_go.set()
        made.reader.close()
        threads.shutdown()


def client_of(served: Served, name: str = "plan", kind: Any = PlanGrasp) -> Any:
    client = served.client.create_client(kind, name, qos_profile=QoSProfile(depth=1000))
    assert client.wait_for_service(LIMIT_S)
    return client


def answers(futures: list[Any]) -> list[Any]:
    deadline = time.monotonic() + LIMIT_S
    while not all(future.done() for future in futures):
        assert time.monotonic() < deadline, "an answer is missing"
        time.sleep(0.01)
    return [future.result() for future in futures]


def test_what_came_before_anybody_read_is_answered_each_with_its_own(served: Served) -> None:
    client = client_of(served)
    names = [f"part{k}" for k in range(MANY)]
    futures = [served.call(client, name) for name in names]
    time.sleep(1.0)  # until all are in the reader's history
    assert not served.begun
    served.reader.start()
    assert [a.message for a in answers(futures)] == [f"answer to {name}" for name in names]


def test_requests_are_begun_in_the_order_in_which_they_came(served: Served) -> None:
    client = client_of(served)
    served.threads.shutdown()
    served.reader._threads = ThreadPoolExecutor(1)
    names = [f"part{k}" for k in range(MANY)]
    futures = [served.call(client, name) for name in names]
    served.reader.start()
    answers(futures)
    assert served.begun == names
    served.reader._threads.shutdown()


def test_an_answer_that_takes_long_does_not_hold_up_the_others(served: Served) -> None:
    client, lists = client_of(served), client_of(served, "list", ListMeshes)
    served.reader.start()
    slow = [served.call(client, f"waits{k}") for k in range(4)]
    quick = [served.call(client, "quick"), lists.call_async(ListMeshes.Request())]
    assert answers(quick)[0].message == "answer to quick"
    assert not any(future.done() for future in slow)
    served.let_go.set()
    assert {a.message for a in answers(slow)} == {f"answer to waits{k}" for k in range(4)}


def test_a_failed_answer_is_logged_and_costs_nobody_else_theirs(
    served: Served, capfd: pytest.CaptureFixture[str]
) -> None:
    client = client_of(served)
    served.reader.start()
    lost = served.call(client, "fails")
    assert answers([served.call(client, "after")])[0].message == "answer to after"
    assert not lost.done()
    logged, deadline = "", time.monotonic() + LIMIT_S
    while "An answer was not sent: ValueError('an answer that failed')" not in logged:
        assert time.monotonic() < deadline, logged
        logged += capfd.readouterr().err
        time.sleep(0.01)


def test_what_can_be_answered_at_once_needs_no_thread(served: Served) -> None:
    client = client_of(served)
    served.threads.shutdown()
    served.reader.start()
    futures = [served.call(client, f"at once {k}") for k in range(MANY)]
    assert {a.message for a in answers(futures)} == {"request-reader"}
    assert not served.begun


def test_a_failed_beginning_costs_nobody_else_their_answer(served: Served) -> None:
    client = client_of(served)
    served.reader.start()
    lost = served.call(client, "cannot begin")
    assert answers([served.call(client, "after")])[0].message == "answer to after"
    assert not lost.done()


def test_after_the_end_what_was_begun_is_answered_and_nothing_new_is_read(served: Served) -> None:
    client = client_of(served)
    served.reader.start()
    begun = served.call(client, "waits")
    deadline = time.monotonic() + LIMIT_S
    while not served.begun:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    served.reader.close()
    served.reader.close()
    late = served.call(client, "late")
    served.let_go.set()
    assert answers([begun])[0].message == "answer to waits"
    time.sleep(0.5)
    assert served.begun == ["waits"]
    assert not late.done()


def test_requests_that_no_thread_is_left_for_end_nothing(served: Served) -> None:
    client = client_of(served)
    served.threads.shutdown()
    served.reader.start()
    served.call(client, "one")
    time.sleep(0.5)
    assert served.reader._thread.is_alive()


def test_an_end_before_the_beginning_is_allowed(served: Served) -> None:
    served.reader.close()


def test_the_thread_ends_with_its_context() -> None:
    with plain_node("server") as server, ThreadPoolExecutor(1) as threads:
        reader = RequestReader(server, threads)
        reader.offer(ListMeshes, "list", later(lambda _request, _response: None))
        reader.start()
        server.context.shutdown()
        reader._thread.join(LIMIT_S)
        assert not reader._thread.is_alive()
        reader.close()
