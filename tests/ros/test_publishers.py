"""The last grasp as others hear it: whole, with one stamp, also by who comes late."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import Pose, PoseArray, PoseStamped
from rclpy.node import Node
from real_node import plain_node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from gpis_grasp_msgs.msg import Grasp
from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.hand.description import HandDescription, load_hand
from gpis_grasp_planner.hand.settings import HandSettings
from gpis_grasp_planner.ros import publishers as module
from gpis_grasp_planner.ros.publishers import LATCHED_QOS, GraspPublishers
from gpis_grasp_planner.ros.settings import NodeSettings

LIMIT_S = 30.0
TOPICS = {
    "grasp": Grasp,
    "palm_pose": PoseStamped,
    "palm_poses": PoseArray,
    "grasp_object_pose": PoseStamped,
    "grasp_joint_states": JointState,
    "grasp_markers": MarkerArray,
    "robot_description": String,
}


@pytest.fixture(scope="module")
def hand() -> HandDescription:
    return load_hand(HandSettings().model)


def grasp(hand: HandDescription, number: int) -> Grasp:
    """One that can be told from others by its stamp, frame and position."""
    made = Grasp(mesh_id="mug")
    made.palm_pose.header.frame_id = f"cell{number}"
    made.palm_pose.header.stamp.sec = number
    made.palm_pose.pose.position.x = float(number)
    made.palm_pose.pose.orientation.w = 1.0
    for joints in (made.grasp, made.pre_grasp):
        joints.header = made.palm_pose.header
        joints.name = list(hand.joint_names)
        joints.position = [0.1 * number] * len(joints.name)
    return made


class Published:
    """The publishers on a node that a thread spins."""

    def __init__(self, node: Node, hand: HandDescription) -> None:
        self.file: Callable[[str], tuple[Path, float] | None] = lambda _mesh_id: None
        self.node = node
        self.publishers = GraspPublishers(
            node, hand, lambda mesh_id: self.file(mesh_id), lambda: NodeSettings()
        )


@pytest.fixture
def published(hand: HandDescription) -> Iterator[Published]:
    with plain_node("publishing", spins=True) as node:
        yield Published(node, hand)


class Listener:
    """Everything that comes on all topics, in order."""

    def __init__(self, node: Node) -> None:
        self.heard: dict[str, list[Any]] = {name: [] for name in TOPICS}
        for name, kind in TOPICS.items():
            node.create_subscription(kind, name, self.heard[name].append, LATCHED_QOS)

    def wait(self, condition: Callable[[dict[str, list[Any]]], bool]) -> None:
        deadline = time.monotonic() + LIMIT_S
        while not condition(self.heard):
            assert time.monotonic() < deadline, {n: len(m) for n, m in self.heard.items()}
            time.sleep(0.01)


def test_a_late_listener_gets_the_last_grasp_whole(
    published: Published, hand: HandDescription
) -> None:
    published.publishers.publish([grasp(hand, 1)], Pose())
    best, second = grasp(hand, 3), grasp(hand, 3)
    second.palm_pose.pose.position.x = 33.0
    where = Pose()
    where.position.z = 0.75
    published.publishers.publish([best, second], where)
    with plain_node("late", spins=True) as node:
        late = Listener(node)
        late.wait(lambda heard: all(heard.values()))
        last = {name: messages[-1] for name, messages in late.heard.items()}
    assert all(len(m) == 1 for name, m in late.heard.items() if name != "grasp_markers")
    assert last["grasp"] == best
    assert last["palm_pose"] == best.palm_pose
    assert last["grasp_joint_states"] == best.grasp
    assert [pose.position.x for pose in last["palm_poses"].poses] == [3.0, 33.0]
    assert last["grasp_object_pose"].pose == where
    headers = [last[name].header for name in TOPICS if hasattr(last[name], "header")]
    assert len(headers) == 4
    assert all(header == best.palm_pose.header for header in headers)
    frames = {m.header.frame_id for m in last["grasp_markers"].markers if m.action == Marker.ADD}
    assert frames == {"cell3"}
    assert all(joint in last["robot_description"].data for joint in hand.joint_names)


def test_answers_at_once_do_not_mix(published: Published, hand: HandDescription) -> None:
    with plain_node("listening", spins=True) as node:
        listener = Listener(node)
        listener.wait(lambda heard: bool(heard["robot_description"]))
        together = threading.Barrier(4)

        def publish(first: int) -> None:
            together.wait()
            for k in range(10):
                published.publishers.publish([grasp(hand, first + k)], Pose())
                time.sleep(0.01)

        threads = [threading.Thread(target=publish, args=(100 * t,)) for t in range(1, 5)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        last = 0
        deadline = time.monotonic() + LIMIT_S
        names = ("grasp", "palm_pose", "palm_poses", "grasp_joint_states", "grasp_object_pose")
        while last == 0 and time.monotonic() < deadline:
            seen = {n: stamp(listener.heard[n][-1]) for n in names if listener.heard[n]}
            if len(seen) == len(names) and len(set(seen.values())) == 1:
                last = set(seen.values()).pop()
            time.sleep(0.05)
        assert last % 100 == 9, "topics end with different answers"
        listener.wait(lambda heard: bool(heard["grasp_markers"]))


def stamp(message: Any) -> int:
    header = message.palm_pose.header if isinstance(message, Grasp) else message.header
    return int(header.stamp.sec)


def test_markers_are_drawn_of_the_newest_and_the_timer_then_rests(
    published: Published, hand: HandDescription
) -> None:
    with plain_node("listening", spins=True) as node:
        listener = Listener(node)
        listener.wait(lambda heard: bool(heard["robot_description"]))
        for number in range(1, 6):
            published.publishers.publish([grasp(hand, number)], Pose())
        listener.wait(
            lambda heard: (
                bool(heard["grasp_markers"])
                and any(m.header.frame_id == "cell5" for m in heard["grasp_markers"][-1].markers)
            )
        )
        timer = published.publishers._drawing
        listener.wait(lambda _: timer.is_canceled())
        drawn = len(listener.heard["grasp_markers"])
        assert drawn < 5
        published.publishers.publish([grasp(hand, 6)], Pose())
        listener.wait(lambda heard: len(heard["grasp_markers"]) > drawn)


def test_the_part_is_drawn_from_its_file_where_viewers_can_read_it(
    published: Published, hand: HandDescription, tmp_path: Path
) -> None:
    def shown() -> list[str]:
        before = len(listener.heard["grasp_markers"])
        published.publishers.publish([grasp(hand, 1)], Pose())
        listener.wait(lambda heard: len(heard["grasp_markers"]) > before)
        return [m.mesh_resource for m in listener.heard["grasp_markers"][-1].markers]

    def gone(_mesh_id: str) -> None:
        raise RequestError("gone")

    uri = (tmp_path / "mug.stl").as_uri()
    with plain_node("listening", spins=True) as node:
        listener = Listener(node)
        listener.wait(lambda heard: bool(heard["robot_description"]))
        published.file = lambda _mesh_id: (tmp_path / "mug.stl", 0.001)
        assert uri in shown()
        published.file = gone
        assert uri not in shown()


def test_meshes_of_an_installed_package_have_uris_that_other_machines_can_follow(
    monkeypatch: pytest.MonkeyPatch, hand: HandDescription, tmp_path: Path
) -> None:
    def not_found(name: str) -> Path:
        raise module.PackageNotFoundError(name)

    monkeypatch.setattr(module, "get_package_share_path", not_found)
    assert module._mesh_uri_prefix(hand) is None
    monkeypatch.setattr(module, "get_package_share_path", lambda _name: tmp_path)
    assert module._mesh_uri_prefix(hand) is None
    inside = hand.urdf_path.parent.as_posix().rpartition("/gpis_grasp_planner/")[2]
    (tmp_path / inside).mkdir(parents=True)
    assert module._mesh_uri_prefix(hand) == f"package://gpis_grasp_planner/{inside}"
    own = tmp_path / "own" / "hand.urdf"
    own.parent.mkdir()
    assert module._mesh_uri_prefix(replace(hand, urdf_path=own)) is None
