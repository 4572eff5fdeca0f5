"""One node, as users start it, over real DDS: good calls, every bad input, the next good call."""

from __future__ import annotations

import math
import os
import shutil
import signal
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy.time
from geometry_msgs.msg import Point, Pose, PoseStamped, PoseWithCovariance, Quaternion
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from visualization_msgs.msg import MarkerArray

from gpis_grasp_msgs.msg import Grasp, PartPose, PartPoses
from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.catalogue import default_catalogue_directory

LATCHED = QoSProfile(
    depth=1,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
)
MAX_POSE_AGE_S = 3.0


def stl(triangles: np.ndarray, count: int | None = None) -> bytes:
    """Binary STL of triangles (n, 3, 3)."""
    data = bytes(80) + struct.pack("<I", len(triangles) if count is None else count)
    for corners in triangles:
        data += struct.pack("<12fH", 0, 0, 0, *corners.ravel(), 0)
    return data


def box(side_m: float) -> np.ndarray:
    """Triangles (12, 3, 3) of a cube, seen counter-clockwise from outside."""
    x = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)]) * side_m
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return np.array([[x[a], x[b], x[c]] for q in quads for a, b, c in (q[:3], (q[0], *q[2:]))])


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A catalogue with one good part and every kind of bad one."""
    folder = tmp_path_factory.mktemp("parts")
    for name in ("mug.stl", "mug.yaml", "sphere.stl", "sphere.yaml"):
        shutil.copy(default_catalogue_directory() / name, folder)
    cube = stl(box(0.05))
    (folder / "empty.stl").write_bytes(b"")
    (folder / "truncated.stl").write_bytes(cube[: len(cube) // 2])
    broken = box(0.05)
    broken[3, 1, 2] = math.nan
    (folder / "nan.stl").write_bytes(stl(broken))
    (folder / "millimetres.stl").write_bytes(stl(box(50.0)))
    (folder / "crate.stl").write_bytes(stl(box(0.9)))
    outside = tmp_path_factory.mktemp("outside") / "secret.stl"
    outside.write_bytes(cube)
    (folder / "link.stl").symlink_to(outside)
    os.mkfifo(folder / "pipe.stl")
    return folder


@pytest.fixture(scope="module")
def node(start_node: Callable[..., Any], parts: Path) -> Iterator[Any]:
    started = start_node(
        {
            "mesh_directories": f"[{parts}]",
            "max_pose_age_s": str(MAX_POSE_AGE_S),
            "planning_grace_s": "60.0",
            "default_planner": "hpp",
            "queue_size": "1",
            "diagnostics_period_s": "0.2",
        }
    )
    started.wait_ready()
    yield started
    assert started.end() == 0, started.text()


@pytest.fixture(scope="module")
def planned(node: Any, client: Any) -> PlanGrasp.Response:
    """A first good answer, which the later ones with the same request come from."""
    response = client.plan("mug")
    assert response.success, response.message
    assert not response.from_cache
    return response


@pytest.fixture
def subscribe(client: Any) -> Iterator[Callable[..., list[Any]]]:
    made = []

    def start(kind: type, topic: str, qos: QoSProfile = LATCHED) -> list[Any]:
        received: list[Any] = []
        made.append(client.node.create_subscription(kind, topic, received.append, qos))
        return received

    yield start
    for subscription in made:
        client.node.destroy_subscription(subscription)


def pose(frame: str = "world", xyz: Any = (0.5, 0.0, 0.0), xyzw: Any = (0, 0, 0, 1)) -> PoseStamped:
    p, q = ([float(v) for v in values] for values in (xyz, xyzw))
    return PoseStamped(
        header=Header(frame_id=frame),
        pose=Pose(
            position=Point(x=p[0], y=p[1], z=p[2]),
            orientation=Quaternion(x=q[0], y=q[1], z=q[2], w=q[3]),
        ),
    )


def stamped(client: Any, age_s: float, **fields: Any) -> PoseStamped:
    message = pose(**fields)
    now = client.node.get_clock().now()
    message.header.stamp = (now - rclpy.time.Duration(seconds=age_s)).to_msg()
    return message


def matrix(message: Pose) -> np.ndarray:
    """Homogeneous matrix of a pose, by the textbook formula."""
    q, p = message.orientation, message.position
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), p.x],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), p.y],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), p.z],
            [0, 0, 0, 1],
        ]
    )


def test_a_good_answer_is_complete(planned: PlanGrasp.Response) -> None:
    assert planned.code == PlanGrasp.Response.SUCCESS
    assert 1 <= len(planned.grasps) <= 20
    epsilons = [grasp.epsilon for grasp in planned.grasps]
    assert epsilons[0] > 0.0
    assert planned.evaluations > 0
    for grasp in planned.grasps:
        assert grasp.palm_pose.header.frame_id == "world"
        assert grasp.mesh_id == "mug"
        assert len(grasp.mesh_hash) == 64
        assert len(grasp.grasp.name) == len(grasp.grasp.position) == 8
        assert grasp.grasp.name == grasp.pre_grasp.name
        assert len(grasp.contacts) >= 2
        assert grasp.approach_distance > 0.0
        assert not grasp.verification.attempted
        numbers = [
            *grasp.grasp.position,
            grasp.epsilon,
            grasp.volume,
            grasp.palm_pose.pose.position.x,
        ]
        assert np.isfinite(numbers).all()


def test_the_second_call_comes_from_memory_also_for_another_pose(
    client: Any, planned: PlanGrasp.Response
) -> None:
    half = math.sqrt(0.5)
    there = pose("shelf", (1.0, 2.0, 3.0), (0.0, 0.0, half, half))
    response = client.plan("mug", object_pose=there)
    assert response.success
    assert response.from_cache
    T_here, T_there = matrix(pose().pose), matrix(there.pose)
    assert len(response.grasps) == len(planned.grasps)
    for old, new in zip(planned.grasps, response.grasps, strict=True):
        assert new.palm_pose.header.frame_id == "shelf"
        T_object_palm = np.linalg.inv(T_here) @ matrix(old.palm_pose.pose)
        assert np.allclose(matrix(new.palm_pose.pose), T_there @ T_object_palm, atol=1e-9)
        assert new.grasp.position == old.grasp.position
        assert new.epsilon == old.epsilon


def test_fewer_grasps_are_the_first_of_the_same_plan(
    client: Any, planned: PlanGrasp.Response
) -> None:
    response = client.plan("mug", n_grasps=1)
    assert response.from_cache
    assert response.grasps == planned.grasps[:1] or (
        response.grasps[0].grasp.position == planned.grasps[0].grasp.position
    )
    assert len(response.grasps) == 1


def test_the_sign_of_the_quaternion_is_free(client: Any, planned: PlanGrasp.Response) -> None:
    a = client.plan("mug", object_pose=pose(xyzw=(0.0, 0.6, 0.0, 0.8))).grasps[0].palm_pose.pose
    b = client.plan("mug", object_pose=pose(xyzw=(0.0, -0.6, 0.0, -0.8))).grasps[0].palm_pose.pose
    assert a == b


def test_a_late_subscriber_gets_the_last_grasp_and_the_hand(
    client: Any, planned: PlanGrasp.Response, subscribe: Callable[..., list[Any]], tools: Any
) -> None:
    response = client.plan("mug", object_pose=stamped(client, 0.5, frame="late"))
    best = response.grasps[0]
    topics = {
        "palm_pose": PoseStamped,
        "grasp_joint_states": JointState,
        "grasp": Grasp,
        "grasp_markers": MarkerArray,
        "robot_description": String,
    }
    got = {topic: subscribe(kind, topic) for topic, kind in topics.items()}
    tools.wait(lambda: all(got.values()), f"latched messages on {list(topics)}")
    assert got["palm_pose"][-1] == best.palm_pose
    assert got["grasp_joint_states"][-1] == best.grasp
    assert got["grasp"][-1] == best
    assert got["palm_pose"][-1].header.stamp == got["grasp_joint_states"][-1].header.stamp
    assert "<robot" in got["robot_description"][-1].data
    namespaces = [marker.ns for marker in got["grasp_markers"][-1].markers]
    assert namespaces.count("contacts") == namespaces.count("normals_inward") == len(best.contacts)
    assert namespaces.count("hand") > 8


NAN = math.nan
BAD_REQUESTS = {
    "unknown mesh": ({"mesh_id": "mugg"}, "UNKNOWN_MESH", ["mugg", "mug"]),
    "out of the catalogue": ({"mesh_id": "../mug"}, "INVALID_MESH_ID", ["../mug"]),
    "absolute": ({"mesh_id": "/etc/passwd"}, "INVALID_MESH_ID", ["letters"]),
    "encoded": ({"mesh_id": "%2e%2e%2fmug"}, "INVALID_MESH_ID", ["letters"]),
    "newline": ({"mesh_id": "mug\nmug"}, "INVALID_MESH_ID", ["\\n"]),
    "very long": ({"mesh_id": "m" * 5000}, "INVALID_MESH_ID", ["64"]),
    "no ID": ({"mesh_id": ""}, "INVALID_MESH_ID", ["letters"]),
    "link": ({"mesh_id": "link"}, "INVALID_MESH_ID", ["link"]),
    "pipe": ({"mesh_id": "pipe"}, "INVALID_MESH_ID", ["pipe"]),
    "empty mesh": ({"mesh_id": "empty"}, "MESH_EMPTY", ["empty"]),
    "truncated mesh": ({"mesh_id": "truncated"}, "MESH_UNREADABLE", ["truncated"]),
    "NaN in mesh": ({"mesh_id": "nan"}, "MESH_NOT_FINITE", ["nan"]),
    "millimetres": ({"mesh_id": "millimetres"}, "MESH_EXTENT_IMPLAUSIBLE", ["50", "mm"]),
    "nothing graspable": ({"mesh_id": "crate"}, "NO_FEASIBLE_GRASP", ["900"]),
    "empty frame": ({"object_pose": pose(frame="")}, "EMPTY_FRAME", ["frame_id"]),
    "bad frame": ({"object_pose": pose(frame="a b")}, "EMPTY_FRAME", ["'a b'"]),
    "NaN pose": ({"object_pose": pose(xyz=(NAN, 0, 0))}, "POSE_NOT_FINITE", ["nan"]),
    "infinite pose": ({"object_pose": pose(xyzw=(0, 0, 0, math.inf))}, "POSE_NOT_FINITE", ["inf"]),
    "zero quaternion": ({"object_pose": pose(xyzw=(0, 0, 0, 0))}, "INVALID_QUATERNION", ["norm 0"]),
    "long quaternion": (
        {"object_pose": pose(xyzw=(0, 0, 0, 1.01))},
        "INVALID_QUATERNION",
        ["1.01", "0.001"],
    ),
    "negative budget": ({"time_budget": -1.0}, "TIME_BUDGET_OUT_OF_RANGE", ["-1", "[0.1, 120]"]),
    "huge budget": ({"time_budget": 1e9}, "TIME_BUDGET_OUT_OF_RANGE", ["1e+09", "120"]),
    "NaN budget": ({"time_budget": NAN}, "TIME_BUDGET_OUT_OF_RANGE", ["nan", "120"]),
    "too many grasps": ({"n_grasps": 2**32 - 1}, "GRASP_COUNT_OUT_OF_RANGE", ["4294967295", "200"]),
    "unknown planner": ({"planner": "magic"}, "UNKNOWN_PLANNER", ["magic", "hpp"]),
    "negative seed": ({"seed": -2}, "INVALID_SETTING", ["-2"]),
}


@pytest.mark.parametrize("name", BAD_REQUESTS)
def test_bad_requests_are_answered_and_the_next_good_one_served(
    client: Any, planned: PlanGrasp.Response, parts: Path, name: str
) -> None:
    fields, code, words = BAD_REQUESTS[name]
    response = client.plan(**fields)
    assert ErrorCode(response.code).name == code, response.message
    assert not response.success
    assert response.grasps == []
    for word in words:
        assert word in response.message
    assert str(parts) not in response.message
    assert "\n" not in response.message
    if code == "NO_FEASIBLE_GRASP":
        assert all(attempt.epsilon <= 0.0 for attempt in response.best_attempt)
    assert client.plan("mug").success


def test_no_estimate_then_good_then_bad_then_good(
    client: Any, planned: PlanGrasp.Response, tools: Any
) -> None:
    """The life of the topic object_pose, by a reliable and then a best-effort publisher."""

    def ask() -> PlanGrasp.Response:
        return client.plan("mug", object_pose=PoseStamped())

    response = ask()
    assert response.code == ErrorCode.NO_POSE_ESTIMATE
    assert "/object_pose" in response.message
    for frame, reliability in (
        ("camera", QoSReliabilityPolicy.RELIABLE),
        ("lidar", QoSReliabilityPolicy.BEST_EFFORT),
    ):
        publisher = client.node.create_publisher(
            PoseStamped, "object_pose", QoSProfile(depth=1, reliability=reliability)
        )
        tools.wait(lambda publisher=publisher: publisher.get_subscription_count() > 0, "the node")

        def answer_to(
            message: PoseStamped, code: ErrorCode, publisher: Any = publisher
        ) -> PlanGrasp.Response:
            """Publish until the node answers accordingly: best effort may lose a message."""
            last: list[PlanGrasp.Response] = []

            def published() -> bool:
                publisher.publish(message)
                last[:] = [ask()]
                frames = {grasp.palm_pose.header.frame_id for grasp in last[0].grasps}
                return last[0].code == code and frames <= {message.header.frame_id}

            tools.wait(published, f"code {code.name}")
            return last[0]

        good = answer_to(stamped(client, 0.0, frame=frame, xyz=(0, 0, 1)), ErrorCode.SUCCESS)
        T_object_palm = np.linalg.inv(matrix(pose().pose)) @ matrix(
            planned.grasps[0].palm_pose.pose
        )
        expected = matrix(pose(xyz=(0, 0, 1)).pose) @ T_object_palm
        assert np.allclose(matrix(good.grasps[0].palm_pose.pose), expected, atol=1e-9)
        stale = answer_to(stamped(client, 60.0), ErrorCode.STALE_POSE)
        assert f"limit is {MAX_POSE_AGE_S:g} s" in stale.message
        answer_to(stamped(client, -60.0), ErrorCode.INVALID_STAMP)
        answer_to(stamped(client, 0.0, xyz=(NAN, 0, 0)), ErrorCode.POSE_NOT_FINITE)
        answer_to(stamped(client, 0.0, frame=""), ErrorCode.EMPTY_FRAME)
        answer_to(stamped(client, 0.0, xyzw=(0, 0, 0, 0)), ErrorCode.INVALID_QUATERNION)
        answer_to(stamped(client, 0.0), ErrorCode.SUCCESS)
        client.node.destroy_publisher(publisher)


def test_several_parts_at_once_and_the_part_named_goes_first(
    client: Any, planned: PlanGrasp.Response, tools: Any
) -> None:
    publisher = client.node.create_publisher(PartPoses, "part_poses", 1)

    def part(mesh_id: str, frame: str) -> PartPose:
        message = stamped(client, 0.0, frame=frame)
        return PartPose(
            header=message.header, mesh_id=mesh_id, pose=PoseWithCovariance(pose=message.pose)
        )

    def frame_of_mug() -> str:
        parts_message = PartPoses(parts=[part("mug", "tray"), part("sphere", "belt")])
        publisher.publish(parts_message)
        response = client.plan("mug", object_pose=PoseStamped())
        return str(response.grasps[0].palm_pose.header.frame_id) if response.success else ""

    tools.wait(lambda: frame_of_mug() == "tray", "the pose of the mug from part_poses")
    client.node.destroy_publisher(publisher)


def test_while_a_plan_runs_cached_calls_are_answered_and_too_many_are_told_busy(
    client: Any, planned: PlanGrasp.Response, tools: Any
) -> None:
    # One is planned and one waits (queue_size 1); the third, whichever it is, is one too many.
    calls = [
        client.call_async(tools.request("sphere", time_budget=8.0, seed=seed)) for seed in (1, 2, 3)
    ]
    tools.wait(lambda: any(call.done() for call in calls), "a first answer")
    [busy] = [call.result() for call in calls if call.done()]
    assert busy.code == ErrorCode.BUSY
    assert "limit is 1" in busy.message
    cached = client.plan("mug")
    assert cached.success
    assert cached.from_cache
    assert sum(call.done() for call in calls) == 1
    tools.wait(lambda: all(call.done() for call in calls), "both plans", 180.0)
    codes = sorted(call.result().code for call in calls)
    assert codes == [ErrorCode.SUCCESS, ErrorCode.SUCCESS, ErrorCode.BUSY]


def test_identical_calls_at_once_share_one_plan(
    client: Any, planned: PlanGrasp.Response, tools: Any
) -> None:
    futures = [client.call_async(tools.request("sphere", seed=7)) for _ in range(2)]
    tools.wait(lambda: all(future.done() for future in futures), "both answers", 120.0)
    answers = [future.result() for future in futures]
    assert [answer.code for answer in answers] == [ErrorCode.SUCCESS] * 2
    assert sorted(answer.from_cache for answer in answers) == [False, True]
    assert answers[0].grasps[0].epsilon == answers[1].grasps[0].epsilon


def test_a_changed_file_is_planned_anew(
    client: Any, planned: PlanGrasp.Response, parts: Path
) -> None:
    bar, bar_file = stl(box(0.04)), parts / "bar.stl"
    (parts / "bar.yaml").write_text("unit: m\n")
    bar_file.write_bytes(bar)
    first = client.plan("bar")
    assert not first.from_cache
    assert client.plan("bar").from_cache
    bar_file.write_bytes(stl(box(0.05)))
    changed = client.plan("bar")
    assert changed.success
    assert not changed.from_cache
    assert changed.grasps[0].mesh_hash != first.grasps[0].mesh_hash
    bar_file.write_bytes(bar)
    back = client.plan("bar")
    assert back.from_cache
    assert back.grasps[0].mesh_hash == first.grasps[0].mesh_hash


def test_the_death_of_the_planning_process_is_survived(
    node: Any, client: Any, planned: PlanGrasp.Response, tools: Any
) -> None:
    worker = node.wait_worker()
    future = client.call_async(tools.request("sphere", time_budget=30.0, seed=21))

    def processor_ticks() -> int:
        return int(Path(f"/proc/{worker}/stat").read_text().split()[13])

    start = processor_ticks()
    tools.wait(lambda: processor_ticks() > start + 20, "the worker to compute", 60.0)
    os.kill(worker, signal.SIGKILL)
    tools.wait(future.done, "the answer", 60.0)
    answer = future.result()
    assert answer.code == ErrorCode.PLANNING_PROCESS_LOST
    assert "SIGKILL" in answer.message
    assert client.plan("mug").from_cache
    assert client.plan("sphere", seed=22).success
    assert node.wait_worker() != worker
