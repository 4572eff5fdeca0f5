"""Requests answered in this process by the real parts of a node: what is in an answer, and when."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, Vector3, Vector3Stamped
from rclpy.node import Node
from real_node import real_node

from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.ros import answering as module
from gpis_grasp_planner.ros.answering import GraspAnswering
from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.interfaces import Interfaces
from gpis_grasp_planner.ros.parameters import NodeParameters
from gpis_grasp_planner.ros.planning import Planning
from gpis_grasp_planner.ros.request_guard import check_request
from gpis_grasp_planner.ros.tf_listener import TfListener

SETTINGS = (
    "-p default_verification:=none -p default_planner:=hpp -p planning_grace_s:=60.0 "
    "-p tf_wait_s:=0.0"
)
# T_cell_world: half a turn about z, and a step.
T_CELL_WORLD = np.diag([-1.0, -1.0, 1.0, 1.0])
T_CELL_WORLD[:3, 3] = [1.0, 2.0, 3.0]


@pytest.fixture(scope="module")
def interfaces() -> Iterator[Interfaces]:
    """Of a node that nobody spins; tf knows the frame "cell"."""
    with real_node(lambda c: Node("answering", context=c), SETTINGS) as node:
        parameters = NodeParameters(node)
        planning = Planning(node, parameters)
        made = Interfaces(node, parameters, planning)
        frames: TfListener = made.answering._transform.__self__  # type: ignore[attr-defined]
        position, quat_xyzw = T_CELL_WORLD[:3, 3], np.array([0.0, 0.0, 1.0, 0.0])
        assert frames.tree.add("cell", "world", 0, position, quat_xyzw, static=True) is None
        yield made
        planning.close()
        made.close()


@pytest.fixture
def answering(interfaces: Interfaces) -> GraspAnswering:
    return interfaces.answering


def request(mesh_id: str = "sphere", **fields: Any) -> PlanGrasp.Request:
    pose = PoseStamped()
    pose.header.frame_id = "world"
    pose.pose.position.x = 0.5
    pose.pose.orientation.w = 1.0
    values = {"time_budget": 20.0, "n_grasps": 1, "object_pose": pose, **fields}
    return PlanGrasp.Request(mesh_id=mesh_id, **values)


def ask(answering: GraspAnswering, asked: Any, call: Call | None = None, **how: Any) -> Any:
    response = PlanGrasp.Response()
    answering.answer(asked, response, call or Call(), "plan_grasp", **how)
    return response


@pytest.fixture(scope="module")
def planned(interfaces: Interfaces) -> Any:
    response = ask(interfaces.answering, request())
    assert response.success, response.message
    return response


def test_a_plan_is_answered_with_what_was_asked_for(planned: Any) -> None:
    assert planned.code == ErrorCode.SUCCESS
    assert len(planned.grasps) == 1
    assert planned.grasps[0].mesh_id == "sphere"
    assert planned.grasps[0].palm_pose.header.frame_id == "world"
    assert not planned.from_cache
    assert planned.evaluations > 0
    assert planned.best_attempt == []
    assert planned.funnel[0].name == "proposed"
    assert 0.0 < planned.elapsed < 85.0


def test_the_same_request_is_answered_from_memory_and_moves_with_the_part(
    answering: GraspAnswering, planned: Any, tools: Any
) -> None:
    moved = request()
    moved.object_pose.pose.position.x = 0.25
    again = ask(answering, moved)
    assert again.from_cache
    here, there = (tools.matrix(r.grasps[0].palm_pose.pose) for r in (again, planned))
    assert np.allclose(here[:3, :3], there[:3, :3])
    assert np.allclose(here[:3, 3] - there[:3, 3], [-0.25, 0.0, 0.0])


def test_the_answer_is_in_the_frame_that_the_request_names(
    answering: GraspAnswering, planned: Any, tools: Any
) -> None:
    there = ask(answering, request(target_frame="cell"))
    assert there.grasps[0].palm_pose.header.frame_id == "cell"
    T_world_palm = tools.matrix(planned.grasps[0].palm_pose.pose)
    assert np.allclose(tools.matrix(there.grasps[0].palm_pose.pose), T_CELL_WORLD @ T_world_palm)
    same = ask(answering, request(target_frame="world"))
    assert same.grasps[0].palm_pose.pose == planned.grasps[0].palm_pose.pose


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({"mesh_id": "../mug"}, ErrorCode.INVALID_MESH_ID),
        ({"mesh_id": "nonesuch"}, ErrorCode.UNKNOWN_MESH),
        ({"time_budget": -1.0}, ErrorCode.TIME_BUDGET_OUT_OF_RANGE),
        ({"planner": "guess"}, ErrorCode.UNKNOWN_PLANNER),
        ({"object_pose": PoseStamped()}, ErrorCode.NO_POSE_ESTIMATE),
        ({"target_frame": "no where"}, ErrorCode.EMPTY_FRAME),
        ({"target_frame": "unheard_of"}, ErrorCode.NO_TRANSFORM),
    ],
)
def test_what_is_wrong_is_told_before_any_work(
    answering: GraspAnswering, fields: dict[str, Any], code: ErrorCode
) -> None:
    refused = ask(answering, request(**{"mesh_id": "mug", **fields}))
    assert (refused.code, refused.success, refused.grasps) == (code, False, [])
    assert refused.message
    assert refused.evaluations == 0
    assert (answering.last_code, answering.last_message) == (code, refused.message)


def test_answers_are_counted_and_none_stays_in_work(answering: GraspAnswering) -> None:
    before = answering.n_answers
    threads = [
        threading.Thread(target=ask, args=(answering, request("nonesuch"))) for _ in range(20)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert answering.n_answers == before + 20
    assert answering.n_in_work == 0


def test_from_memory_or_not_at_all(answering: GraspAnswering, planned: Any) -> None:
    assert planned.success
    assert ask(answering, request(), only_known=True).from_cache
    unknown = ask(answering, request("phone"), only_known=True)
    assert unknown.code == ErrorCode.NOTHING_KNOWN
    assert not unknown.from_cache


def test_an_unexpected_failure_is_answered_without_its_inside(
    answering: GraspAnswering, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: Any) -> None:
        raise ZeroDivisionError("/a/path/of/this/machine")

    monkeypatch.setattr(answering._plans, "check_mesh_id", fail)
    broken = ask(answering, request())
    assert broken.code == ErrorCode.INTERNAL
    assert "ZeroDivisionError" in broken.message
    assert "/a/path" not in broken.message
    assert answering.n_in_work == 0
    assert "/a/path" in capfd.readouterr().err


def test_a_call_that_nobody_wants_is_not_worked_on(answering: GraspAnswering) -> None:
    call = Call()
    call.cancel("The client went away.")
    gone = ask(answering, request("phone"), call)
    assert gone.code == ErrorCode.CANCELLED
    assert gone.message == "The client went away."
    assert gone.evaluations == 0


def test_the_last_request_that_was_published_is_remembered(
    answering: GraspAnswering, planned: Any
) -> None:
    assert planned.success
    good, bad = request(), request("nonesuch")
    ask(answering, good)
    ask(answering, bad)
    assert answering.last_answered is good


def test_a_tracked_part_does_not_take_the_place_of_what_was_answered_since(
    answering: GraspAnswering, planned: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert planned.success
    tracked, newer = request(), request()
    shown: list[Any] = []
    monkeypatch.setattr(
        answering._publishers, "publish", lambda grasps, _pose: shown.append(grasps)
    )
    ask(answering, tracked)
    assert ask(answering, tracked, only_known=True, again=True).success
    assert len(shown) == 2
    ask(answering, newer)
    assert ask(answering, tracked, only_known=True, again=True).success  # it was under way
    assert len(shown) == 3
    assert answering.last_answered is newer
    answering.forget(tracked)
    assert answering.last_answered is newer
    answering.forget(newer)
    assert answering.last_answered is None


def test_a_tracked_part_does_not_fill_the_log(
    answering: GraspAnswering, planned: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert planned.success
    lines: list[str] = []
    monkeypatch.setattr(module, "log_info", lambda _log, text: lines.append(text))
    tracked, lost = request(), request("nonesuch")
    ask(answering, tracked)
    for _ in range(5):
        ask(answering, tracked, only_known=True, again=True)
    assert len(lines) == 1
    for _ in range(5):
        ask(answering, lost, only_known=True, again=True)
    assert len(lines) == 2  # another code
    assert "UNKNOWN_MESH" in lines[1]


def test_the_approach_is_in_the_frame_of_the_estimate_that_came_meanwhile(
    answering: GraspAnswering, planned: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert planned.success
    before, now = request().object_pose, request().object_pose
    now.header.frame_id = "cell"
    estimates = iter([answering._poses.from_request(before), answering._poses.from_request(now)])
    monkeypatch.setattr(answering._poses, "newest", lambda _mesh_id: next(estimates))
    asked = check_request(0, 20.0, 1, "", "", answering._settings())
    known = answering._plans.known("sphere", asked, Call())
    cones: list[Any] = []

    def plan(_mesh_id: str, asked_for: Any, _call: Any, _place: Any) -> Any:
        cones.append(asked_for.approach)
        return replace(known, from_cache=False)

    def place(delivered: Any, _place: Any, asked_for: Any, _call: Any) -> Any:
        cones.append(asked_for.approach)
        return delivered

    monkeypatch.setattr(answering._plans, "plan", plan)
    monkeypatch.setattr(answering._plans, "place", place)
    along_x = Vector3Stamped(vector=Vector3(x=1.0))
    along_x.header.frame_id = "world"
    said = {"approach_axis": along_x, "approach_half_angle": 0.5, "object_pose": PoseStamped()}
    there = ask(answering, request(**said))
    assert there.grasps[0].palm_pose.header.frame_id == "cell"
    # The cell is turned by half a turn against the world.
    assert [cone.axis.tolist() for cone in cones] == [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]


def test_an_answer_from_memory_that_had_to_wait_is_where_the_part_is_by_then(
    answering: GraspAnswering, planned: Any, tools: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Under a covariance, or behind others that have one, that takes seconds."""
    monkeypatch.setattr(module, "_NEWEST_FOR_S", -1.0)
    before, now = (
        replace(
            answering._poses.from_request(tools.pose(xyz=(x, 0.0, 0.0))),
            covariance=np.diag([1e-6] * 3 + [1e-4] * 3),
            stamp_ns=stamp_ns,
        )
        for x, stamp_ns in ((0.5, 1), (0.9, 2))
    )
    estimates = iter([before, now, replace(now), replace(now)])
    monkeypatch.setattr(answering._poses, "newest", lambda _mesh_id: next(estimates))
    there = ask(answering, request(object_pose=PoseStamped()))
    assert there.success, there.message
    assert there.from_cache
    assert there.grasps[0].palm_pose.header.stamp.nanosec == 2
    assert there.grasps[0].hold_probability >= 0.0
    here = tools.matrix(planned.grasps[0].palm_pose.pose)
    moved = tools.matrix(there.grasps[0].palm_pose.pose)
    assert np.allclose(moved[:3, 3] - here[:3, 3], [0.4, 0.0, 0.0])
    assert len(list(estimates)) == 1  # the third look found nothing newer


def test_while_it_is_worked_on_feedback_shows_grasps_where_the_part_lies(
    answering: GraspAnswering, planned: Any, tools: Any
) -> None:
    assert planned.success
    call = Call()
    assert ask(answering, request(target_frame="cell"), call).success
    asked = check_request(0, 20.0, 1, "", "", answering._settings())
    grasp = answering._plans.known("sphere", asked, Call()).plan.grasps[0]
    shown = call.show(grasp)
    assert shown.palm_pose.header.frame_id == "cell"
    T_world_object = np.eye(4)
    T_world_object[0, 3] = 0.5
    expected = T_CELL_WORLD @ T_world_object @ grasp.T_object_palm
    assert np.allclose(tools.matrix(shown.palm_pose.pose), expected)


def test_many_that_need_a_search_are_busy_before_they_are_looked_at(
    interfaces: Interfaces, planned: Any
) -> None:
    answering, calls, refused = interfaces.answering, list[Call](), list[Any]()
    size = answering._settings().queue_size
    for seed in range(100, 120 + size):
        response, call = PlanGrasp.Response(), Call()
        before = answering.n_answers
        if answering.admits(request(seed=seed), response, call, "plan_grasp"):
            calls.append(call)
            assert answering.n_answers == before
        else:
            refused.append(response)
            assert answering.n_answers == before + 1
    assert (len(calls), len(refused)) == (size + 1, 19)
    assert {answer.code for answer in refused} == {ErrorCode.BUSY}
    assert not any(answer.success or answer.grasps for answer in refused)
    # Neither what is in memory nor what is wrong is told to call again.
    assert answering.admits(request(), PlanGrasp.Response(), Call(), "plan_grasp")
    assert answering.admits(request("nonesuch"), PlanGrasp.Response(), Call(), "plan_grasp")
    wrong = PlanGrasp.Response()
    assert not answering.admits(request(time_budget=-1.0), wrong, Call(), "plan_grasp")
    assert wrong.code == ErrorCode.TIME_BUDGET_OUT_OF_RANGE
    for call in calls:
        answering._plans.release(call)
    again = Call()
    assert answering.admits(request(seed=100), PlanGrasp.Response(), again, "plan_grasp")
    answering._plans.release(again)


def test_a_request_that_failed_keeps_no_place(answering: GraspAnswering, planned: Any) -> None:
    for seed in range(50):
        asked, response, call = (
            request(seed=seed, target_frame="no where"),
            PlanGrasp.Response(),
            Call(),
        )
        assert answering.admits(asked, response, call, "plan_grasp")
        answering.answer(asked, response, call, "plan_grasp")
        assert response.code == ErrorCode.EMPTY_FRAME
