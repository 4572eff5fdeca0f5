"""What others see of a node: there as a whole or not at all, and gone without a trace."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from real_node import plain_node, real_node

from gpis_grasp_msgs.srv import ListMeshes
from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.ros import interfaces as module
from gpis_grasp_planner.ros.interfaces import Interfaces, drain, n_threads
from gpis_grasp_planner.ros.parameters import NodeParameters
from gpis_grasp_planner.ros.planning import Planning

LIMIT_S = 30.0
SERVICES = {"/plan_grasp", "/get_grasps", "/list_meshes", "/plan_grasps_batch"}
KINDS = ("timers", "services", "clients", "subscriptions", "publishers", "guards", "waitables")


@pytest.fixture(scope="module")
def made() -> Iterator[tuple[Node, NodeParameters, Planning]]:
    """A node without interfaces, its parameters, and what it plans with."""
    with real_node(lambda context: Node("seen", context=context)) as node:
        parameters = NodeParameters(node)
        planning = Planning(node, parameters)
        yield node, parameters, planning
        planning.close()


def entities(node: Node) -> dict[str, set[Any]]:
    return {kind: set(getattr(node, kind)) for kind in KINDS}


def offered(node: Node) -> set[str]:
    names = node.get_service_names_and_types_by_node(node.get_name(), node.get_namespace())
    return {name for name, _ in names} & SERVICES


def test_they_are_there_and_gone_and_there_again(made: Any) -> None:
    node, parameters, planning = made
    before, threads = entities(node), threading.active_count()
    for _ in range(2):
        interfaces = Interfaces(node, parameters, planning)
        assert offered(node) == SERVICES
        topics = {name for name, _ in node.get_topic_names_and_types()}
        assert {"/grasp", "/palm_pose", "/grasp_joint_states", "/diagnostics"} <= topics
        assert {"/tf", "/tf_static", "/part_poses", "/object_pose"} <= topics
        assert any(name == "/plan_grasp/_action/status" for name in topics)
        interfaces.destroy()
        assert entities(node) == before
        assert offered(node) == set()
        assert threading.active_count() == threads


def test_they_answer_while_they_are_there(made: Any) -> None:
    interfaces = Interfaces(*made)
    with plain_node("asking", spins=True) as client:
        service = client.create_client(ListMeshes, "list_meshes")
        assert service.wait_for_service(LIMIT_S)
        # Nobody spins the node: services have a thread of their own.
        assert "mug" in [mesh.mesh_id for mesh in service.call(ListMeshes.Request()).meshes]
    interfaces.destroy()


def test_what_cannot_be_made_leaves_nothing_half_made(made: Any) -> None:
    node, parameters, planning = made
    before, threads = entities(node), threading.active_count()

    class Refusing(NodeParameters):
        """Fails where diagnostics, the last of all, are made."""

        @property
        def node(self) -> Any:
            if offered(node) == SERVICES:
                raise RequestError("not now")
            return super().node

    refusing = object.__new__(Refusing)
    refusing.__dict__ = parameters.__dict__
    with pytest.raises(RequestError, match="not now"):
        Interfaces(node, refusing, planning)
    assert entities(node) == before
    assert offered(node) == set()
    assert threading.active_count() == threads


def test_after_close_nothing_is_begun(made: Any) -> None:
    interfaces = Interfaces(*made)
    interfaces.close()
    with pytest.raises(RuntimeError, match="shutdown"):
        interfaces._threads.submit(print)
    interfaces.close()
    interfaces.destroy()


def test_it_waits_for_answers_until_they_are_given_or_the_limit(
    made: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    interfaces = Interfaces(*made)
    interfaces.answering.n_in_work = 1
    monkeypatch.setattr(module, "FAREWELL_S", 0.1)
    began = time.monotonic()
    interfaces.wait_until_answered()
    assert time.monotonic() - began >= 0.1
    monkeypatch.setattr(module, "FAREWELL_S", LIMIT_S)

    def answer() -> None:
        interfaces.answering.n_in_work = 0

    timer = threading.Timer(0.1, answer)
    timer.start()
    interfaces.wait_until_answered()
    assert interfaces.answering.n_in_work == 0
    timer.join()
    interfaces.destroy()


def test_there_are_more_threads_than_requests_that_may_wait_or_be_worked_on(made: Any) -> None:
    node, parameters, _ = made
    # Of each of two lanes one is worked on; that one may hold a turn of both.
    assert n_threads(parameters) > parameters.node.queue_size + 4
    assert not node.set_parameters([Parameter("queue_size", value=1)])[0].successful


def test_draining_waits_for_what_was_begun_but_no_longer_than_its_limit() -> None:
    threads, done, let_go = ThreadPoolExecutor(1), threading.Event(), threading.Event()

    def work() -> None:
        assert let_go.wait(LIMIT_S)
        done.set()

    threads.submit(work)
    drain(threads, 0.05)
    assert not done.is_set()
    with pytest.raises(RuntimeError):
        threads.submit(print)
    let_go.set()
    drain(threads, LIMIT_S)
    assert done.is_set()
