"""What viewers are shown over real DDS: frames, markers, and topics of the saved configurations."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import PoseArray, PoseStamped
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.ros.settings import NodeSettings

SHARE = Path(__file__).resolve().parents[2] / "ros2_ws/src/gpis_grasp_planner"
LATCHED = QoSProfile(
    depth=1,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
)
TYPES = {
    "rviz_default_plugins/MarkerArray": "visualization_msgs/msg/MarkerArray",
    "rviz_default_plugins/Pose": "geometry_msgs/msg/PoseStamped",
    "rviz_default_plugins/PoseArray": "geometry_msgs/msg/PoseArray",
    "rviz_default_plugins/RobotModel": "std_msgs/msg/String",
}


@pytest.fixture(scope="module")
def displays() -> list[dict[str, Any]]:
    """Of the saved RViz configuration."""
    saved = yaml.safe_load((SHARE / "rviz/grasp.rviz").read_text())
    found: list[dict[str, Any]] = saved["Visualization Manager"]["Displays"]
    return found


@pytest.fixture
def latched(client: Any, tools: Any) -> Iterator[Callable[..., Any]]:
    """The last message of a topic, as one that subscribes late gets it."""
    made = []

    def take(kind: type, topic: str, wanted: Callable[[Any], bool] = lambda _: True) -> Any:
        received: list[Any] = []
        made.append(client.node.create_subscription(kind, topic, received.append, LATCHED))
        tools.wait(lambda: any(map(wanted, received)), f"a message on {topic}")
        return next(message for message in reversed(received) if wanted(message))

    yield take
    for subscription in made:
        client.in_executor(client.node.destroy_subscription, subscription)


def test_a_robot_model_finds_every_link_at_the_palm_pose(
    planned: Any, client: Any, latched: Callable[..., Any], tools: Any, displays: Any
) -> None:
    there = tools.stamped(client, 0.5, frame="shelf", xyz=(1.0, 2.0, 3.0), xyzw=(0, 0.6, 0, 0.8))
    best = client.plan("mug", object_pose=there).grasps[0]
    of_this = lambda message: message.transforms[0].header.frame_id == "shelf"  # noqa: E731
    frames = latched(TFMessage, "/tf_static", of_this).transforms
    poses = {"shelf": np.eye(4)}
    for frame in frames:
        assert frame.header.stamp == best.palm_pose.header.stamp
        poses[frame.child_frame_id] = poses[frame.header.frame_id] @ tools.matrix(
            PoseLike(frame.transform)
        )
    [model] = [d for d in displays if d["Class"].endswith("RobotModel")]
    prefix = model["TF Prefix"] + "/"
    assert prefix == NodeSettings().hand_frame_prefix
    urdf = ET.fromstring(latched(String, model["Description Topic"]["Value"]).data)
    links = [link.get("name") for link in urdf.iterfind("link")]
    hand = load_hand()
    expected = tools.matrix(best.palm_pose.pose) @ link_transforms(hand, best.grasp.position)[0]
    assert sorted(links) == sorted(hand.link_names)
    for link, T in zip(hand.link_names, expected, strict=True):
        np.testing.assert_allclose(poses[prefix + link], T, atol=1e-9)


class PoseLike:
    """A transform's message with the names of a pose's."""

    def __init__(self, transform: Any) -> None:
        self.position, self.orientation = transform.translation, transform.rotation


def test_part_and_ways_are_shown_where_the_answer_has_them(
    planned: Any, client: Any, latched: Callable[..., Any], tools: Any, parts: Path
) -> None:
    there = tools.stamped(client, 0.5, frame="tray", xyz=(0.2, 0.0, 0.9))
    answer = client.plan("mug", object_pose=there)
    of_this = lambda message: message.header.frame_id == "tray"  # noqa: E731
    assert latched(PoseStamped, "grasp_object_pose", of_this).pose == there.pose
    assert len(latched(PoseArray, "palm_poses", of_this).poses) == len(answer.grasps)
    drawn = latched(MarkerArray, "grasp_markers", lambda m: of_this(m.markers[0]))
    [part] = [m for m in drawn.markers if m.ns == "part"]
    assert part.mesh_resource == (parts / "mug.stl").resolve().as_uri()
    assert part.pose == there.pose
    unit = {"m": 1.0, "mm": 1e-3}[yaml.safe_load((parts / "mug.yaml").read_text())["unit"]]
    assert part.scale.x == unit
    ways = [m for m in drawn.markers if m.ns in ("way", "ways")]
    assert [m.points[1] for m in ways] == [g.palm_pose.pose.position for g in answer.grasps]


def test_lifetime_and_frames_are_parameters_of_the_running_node(
    planned: Any, client: Any, latched: Callable[..., Any], tools: Any
) -> None:
    service = client.node.create_client(SetParameters, "/grasp_planner/set_parameters")
    assert service.wait_for_service(60.0)

    def set_to(lifetime_s: float, frames: str) -> None:
        values = [
            ("marker_lifetime_s", ParameterType.PARAMETER_DOUBLE, {"double_value": lifetime_s}),
            ("hand_frames", ParameterType.PARAMETER_STRING, {"string_value": frames}),
        ]
        request = SetParameters.Request(
            parameters=[
                Parameter(name=name, value=ParameterValue(type=kind, **value))
                for name, kind, value in values
            ]
        )
        future = service.call_async(request)
        tools.wait(future.done, "the parameters")
        assert all(result.successful for result in future.result().results)

    def shown_in(frame: str) -> Any:
        return lambda message: message.header.frame_id == frame

    set_to(1.5, "root")
    client.plan("mug", object_pose=tools.stamped(client, 0.5, frame="short"))
    drawn = latched(MarkerArray, "grasp_markers", lambda m: shown_in("short")(m.markers[0]))
    kept = {(m.lifetime.sec, m.lifetime.nanosec) for m in drawn.markers if m.action == Marker.ADD}
    assert kept == {(1, 500_000_000)}
    frames = latched(TFMessage, "/tf_static", lambda m: shown_in("short")(m.transforms[0]))
    assert [f.child_frame_id for f in frames.transforms] == ["planned/bh_palm_link"]
    set_to(0.0, "none")
    client.plan("mug", object_pose=tools.stamped(client, 0.5, frame="none"))
    latched(MarkerArray, "grasp_markers", lambda m: shown_in("none")(m.markers[0]))
    last = latched(TFMessage, "/tf_static")
    assert last.transforms[0].header.frame_id == "short"
    set_to(0.0, "links")
    client.in_executor(client.node.destroy_client, service)


def published(client: Any) -> dict[str, list[str]]:
    return dict(client.node.get_publisher_names_and_types_by_node("grasp_planner", "/"))


def test_the_displays_of_rviz_are_topics_of_the_node(
    planned: Any, client: Any, latched: Callable[..., Any], displays: Any
) -> None:
    topics = published(client)
    looked_at = 0
    for display in displays:
        topic = display.get("Topic") or display.get("Description Topic")
        if topic is None:
            continue
        looked_at += 1
        assert topics[f"/{topic['Value']}"] == [TYPES[display["Class"]]], display["Name"]
        assert topic["Durability Policy"] == "Transient Local"  # or a late RViz sees nothing
        for info in client.node.get_publishers_info_by_topic(f"/{topic['Value']}"):
            assert info.qos_profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL
    assert looked_at == 4
    [markers] = [d for d in displays if d["Class"].endswith("MarkerArray")]
    drawn = latched(MarkerArray, "grasp_markers").markers[1:]
    # "ways" are the grasps after the first, of which there may be none
    assert {m.ns for m in drawn} | {"ways"} == set(markers["Namespaces"])


def test_the_layout_of_foxglove_has_topics_of_the_node(planned: Any, client: Any) -> None:
    layout = json.loads((SHARE / "foxglove/grasp.json").read_text())
    panels = layout["configById"]
    named = set(panels["3D!grasp"]["topics"])
    for panel in panels.values():
        path = panel.get("topicPath") or panel.get("topicToRender")
        named |= {path.partition(".")[0]} if path else set()
        for layer in panel.get("layers", {}).values():
            named |= {layer["topic"]} if layer.get("sourceType") == "topic" else set()
    assert len(named) == 7
    assert named <= set(published(client))
    model = panels["3D!grasp"]["layers"]["hand"]
    assert model["framePrefix"] == NodeSettings().hand_frame_prefix
    followed = panels["3D!grasp"]["followTf"]
    assert followed == NodeSettings().hand_frame_prefix + load_hand().palm_link

    def shown(place: Any) -> set[str]:
        if isinstance(place, str):
            return {place}
        return shown(place["first"]) | shown(place["second"])

    assert shown(layout["layout"]) == set(panels)
