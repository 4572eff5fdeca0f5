"""Transitions of the lifecycle node, in this process: what each brings up, takes away, keeps."""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import TransitionCallbackReturn as Outcome

from gpis_grasp_planner.geometry.catalogue import default_catalogue_directory
from gpis_grasp_planner.ros import lifecycle_node as module
from gpis_grasp_planner.ros.lifecycle_node import Errand, GraspPlannerLifecycleNode
from gpis_grasp_planner.ros.planner_node import spin

LIMIT_S = 60.0
SERVICES = {"/plan_grasp", "/get_grasps", "/list_meshes", "/plan_grasps_batch"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A catalogue that is not there yet, for a node that is given it."""
    return tmp_path / "parts"


@pytest.fixture
def node(request: pytest.FixtureRequest) -> Iterator[GraspPlannerLifecycleNode]:
    """An unconfigured one that a thread spins."""
    words = ["--ros-args"]
    if "folder" in request.fixturenames:
        words += ["-p", f"mesh_directories:=[{request.getfixturevalue('folder')}]"]
    rclpy.init(args=words)
    made, stop = GraspPlannerLifecycleNode(), threading.Event()
    thread = threading.Thread(target=spin, args=(made, stop))
    thread.start()
    yield made
    stop.set()
    thread.join(LIMIT_S)
    assert not thread.is_alive()
    rclpy.try_shutdown()


def offered(node: GraspPlannerLifecycleNode) -> set[str]:
    names = node.get_service_names_and_types_by_node(node.get_name(), node.get_namespace())
    return {name for name, _ in names} & SERVICES


def pid_of(node: Any) -> int | None:
    return None if node._planning is None else node._planning.supervisor.pid


def test_the_whole_way_up_and_down_twice(node: GraspPlannerLifecycleNode) -> None:
    assert pid_of(node) is None
    for _ in range(2):
        assert node.trigger_configure() is Outcome.SUCCESS
        pid = pid_of(node)
        assert pid is not None
        assert offered(node) == set()
        assert node.trigger_activate() is Outcome.SUCCESS
        assert offered(node) == SERVICES
        assert pid_of(node) == pid
        assert node.trigger_deactivate() is Outcome.SUCCESS
        assert offered(node) == set()
        assert pid_of(node) == pid  # nobody was waiting for it
        assert node.trigger_cleanup() is Outcome.SUCCESS
        assert pid_of(node) is None
        assert not Path(f"/proc/{pid}").exists()


def test_deactivated_it_keeps_its_plans_and_forgets_them_when_cleaned_up(node: Any) -> None:
    node.trigger_configure()
    cache = node._planning.plans.cache
    node.trigger_activate()
    node.trigger_deactivate()
    assert node._planning.plans.cache is cache
    node.trigger_activate()
    assert node._planning.plans.cache is cache
    node.trigger_deactivate()
    node.trigger_cleanup()
    node.trigger_configure()
    assert node._planning.plans.cache is not cache


def test_where_requests_are_in_work_a_deactivation_renews_the_process(node: Any) -> None:
    node.trigger_configure()
    node.trigger_activate()
    pid, cache = pid_of(node), node._planning.plans.cache
    answering = node._interfaces.answering
    answering.n_in_work = 1
    threading.Timer(0.2, lambda: setattr(answering, "n_in_work", 0)).start()
    assert node.trigger_deactivate() is Outcome.SUCCESS
    assert not Path(f"/proc/{pid}").exists()
    assert pid_of(node) not in (None, pid)
    assert node._planning.plans.cache is cache


def test_a_configuration_that_does_not_work_fails_and_may_be_mended(
    folder: Path, node: GraspPlannerLifecycleNode
) -> None:
    assert node.trigger_configure() is Outcome.FAILURE
    assert pid_of(node) is None
    folder.mkdir()
    shutil.copy(default_catalogue_directory() / "mug.stl", folder)
    assert node.trigger_configure() is Outcome.SUCCESS
    assert pid_of(node) is not None


def test_a_shutdown_from_active_leaves_nothing(node: GraspPlannerLifecycleNode) -> None:
    node.trigger_configure()
    node.trigger_activate()
    pid = pid_of(node)
    assert node.trigger_shutdown() is Outcome.SUCCESS
    assert offered(node) == set()
    assert not Path(f"/proc/{pid}").exists()


def test_an_errand_is_run_by_the_thread_that_spins(node: GraspPlannerLifecycleNode) -> None:
    ran: list[int] = []
    node._between_spins(lambda: ran.append(threading.get_ident()))
    assert len(ran) == 1
    assert ran[0] != threading.get_ident()
    with pytest.raises(ZeroDivisionError):
        node._between_spins(lambda: 1 // 0)  # type: ignore[arg-type, return-value]
    node._between_spins(lambda: ran.append(0))
    assert ran[1:] == [0]


def test_an_errand_that_was_not_begun_in_time_is_not_done_later(
    node: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "ERRAND_LIMIT_S", 0.1)
    let_go, ran = threading.Event(), []
    holding = Errand(lambda: let_go.wait(LIMIT_S))  # type: ignore[arg-type, return-value]
    node._errands.put(holding)
    deadline = time.monotonic() + LIMIT_S
    while not holding.running():
        assert time.monotonic() < deadline
        time.sleep(0.01)
    with pytest.raises(TimeoutError):
        node._between_spins(lambda: ran.append("late"))
    let_go.set()
    node._errands.put(done := Errand(lambda: ran.append("next")))
    done.result(LIMIT_S)
    assert ran == ["next"]


@pytest.mark.parametrize("label", ["", "activate", "nonsense"])
def test_a_transition_that_is_not_of_this_state_is_answered(node: Any, label: str) -> None:
    asked = ChangeState.Request()
    asked.transition.id, asked.transition.label = Transition.TRANSITION_ACTIVATE, label
    answered = node._service_change_state.callback(asked, ChangeState.Response(success=True))
    assert not answered.success
    assert node._state_machine.current_state[1] == "unconfigured"
    assert node.trigger_configure() is Outcome.SUCCESS
