"""The managed node: its transitions, what there is in each state, and what stays in memory."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState

from gpis_grasp_planner.errors import ErrorCode

NAME = "grasp_planner"


class Manager:
    """Changes the node's state as ``ros2 lifecycle set`` does."""

    def __init__(self, client: Any, tools: Any) -> None:
        self._tools = tools
        self._node = client.node
        self._change = client.node.create_client(ChangeState, f"/{NAME}/change_state")
        self._state = client.node.create_client(GetState, f"/{NAME}/get_state")

    def _call(self, service: Any, request: Any) -> Any:
        assert service.wait_for_service(60.0)
        future = service.call_async(request)
        self._tools.wait(future.done, "an answer", 60.0)
        return future.result()

    def set(self, transition: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=transition))
        return bool(self._call(self._change, request).success)

    @property
    def state(self) -> int:
        return int(self._call(self._state, GetState.Request()).current_state.id)

    def services(self) -> set[str]:
        found = self._node.get_service_names_and_types_by_node(NAME, "/")
        return {name for name, _ in found if not name.startswith(f"/{NAME}/")}

    def topics(self) -> set[str]:
        found = self._node.get_publisher_names_and_types_by_node(NAME, "/")
        return {name for name, _ in found}


@pytest.fixture
def manager(client: Any, tools: Any) -> Iterator[Manager]:
    made = Manager(client, tools)
    yield made
    for service in (made._change, made._state):
        client.in_executor(client.node.destroy_client, service)


def test_all_states_and_back(
    start_node: Callable[..., Any], client: Any, manager: Manager, tools: Any, parts: Path
) -> None:
    process = start_node(
        {"mesh_directories": f"[{parts}]", "planning_grace_s": "60.0"}, main="main_lifecycle"
    )
    assert manager.state == State.PRIMARY_STATE_UNCONFIGURED
    assert not process.workers()
    assert manager.set(Transition.TRANSITION_CONFIGURE)
    assert manager.state == State.PRIMARY_STATE_INACTIVE
    worker = process.wait_worker()
    assert "/plan_grasp" not in manager.services()

    assert manager.set(Transition.TRANSITION_ACTIVATE)
    process.wait_ready()
    tools.wait(lambda: "/plan_grasp" in manager.services(), "the service")
    assert "/palm_pose" in manager.topics()
    client.prepare("sphere")
    first = client.plan("sphere", time_budget=3.0)
    assert first.success, first.message

    assert manager.set(Transition.TRANSITION_DEACTIVATE)
    assert manager.state == State.PRIMARY_STATE_INACTIVE
    tools.wait(lambda: "/plan_grasp" not in manager.services(), "the service's end")
    tools.wait(lambda: not {"/palm_pose", "/diagnostics"} & manager.topics(), "the topics' end")
    assert not any("plan_grasp" in name for name in manager.services())
    assert process.workers() == [worker]  # warm for the next activation

    assert manager.set(Transition.TRANSITION_ACTIVATE)
    again = client.plan("sphere", time_budget=3.0)
    assert again.from_cache
    assert again.grasps[0].palm_pose.pose == first.grasps[0].palm_pose.pose

    assert manager.set(Transition.TRANSITION_DEACTIVATE)
    assert manager.set(Transition.TRANSITION_CLEANUP)
    assert manager.state == State.PRIMARY_STATE_UNCONFIGURED
    tools.wait(lambda: not process.workers(), "the end of the planning process")
    assert manager.set(Transition.TRANSITION_CONFIGURE)
    assert manager.set(Transition.TRANSITION_ACTIVATE)
    fresh = client.plan("sphere", time_budget=3.0)
    assert not fresh.from_cache
    assert manager.set(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert manager.state == State.PRIMARY_STATE_FINALIZED
    assert process.end() == 0, process.text()
    assert "Traceback" not in process.text()


def test_a_call_in_work_is_answered_when_the_node_is_deactivated(
    start_node: Callable[..., Any], client: Any, manager: Manager, tools: Any, parts: Path
) -> None:
    process = start_node({"mesh_directories": f"[{parts}]"}, main="main_lifecycle")
    for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
        assert manager.set(transition)
    process.wait_ready()
    future = client.call_async(tools.request("mug", time_budget=60.0))
    answered = threading.Event()
    future.add_done_callback(lambda _: answered.set())
    assert not answered.wait(3.0)  # it is in work by then, or on its way there
    assert manager.set(Transition.TRANSITION_DEACTIVATE)
    assert answered.wait(30.0)
    assert future.result().code == ErrorCode.SHUTTING_DOWN
    assert manager.set(Transition.TRANSITION_ACTIVATE)
    assert client.plan("sphere", time_budget=5.0).code != ErrorCode.SHUTTING_DOWN
    assert process.end() == 0, process.text()


def test_what_cannot_be_configured_stays_unconfigured(
    start_node: Callable[..., Any], manager: Manager, tmp_path: Path
) -> None:
    process = start_node({"mesh_directories": f"[{tmp_path / 'nowhere'}]"}, main="main_lifecycle")
    assert not manager.set(Transition.TRANSITION_CONFIGURE)
    assert manager.state == State.PRIMARY_STATE_UNCONFIGURED
    assert "Not configured: " in process.text()
    assert process.end() == 0, process.text()


def test_what_cannot_be_activated_stays_inactive_and_goes_on(
    start_node: Callable[..., Any], client: Any, manager: Manager, parts: Path
) -> None:
    """A type of poses that is not installed: half of the entities are made by then."""
    hidden = "import sys; sys.modules['vision_msgs.msg'] = None; "
    process = start_node(
        {"mesh_directories": f"[{parts}]", "pose_type": "detection3d_array"},
        main="main_lifecycle",
        before=hidden,
    )
    assert manager.set(Transition.TRANSITION_CONFIGURE)
    for _ in range(2):
        assert not manager.set(Transition.TRANSITION_ACTIVATE)
        assert manager.state == State.PRIMARY_STATE_INACTIVE
    assert "vision_msgs is not installed" in process.text()
    assert not any("plan_grasp" in name for name in manager.services())
    assert manager.set(Transition.TRANSITION_CLEANUP)
    assert process.end() == 0, process.text()
