"""The SROS2 policy names what the live node has, and nothing that it never has."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState

NAME = "grasp_planner"
POLICY = (
    Path(__file__).resolve().parents[2]
    / "ros2_ws/src/gpis_grasp_planner/policies/grasp_planner.policy.xml"
)
# Subscribed to only where simulated time or another type of poses is asked for.
BY_PARAMETER = {"/clock", "/detections"}


def absolute(name: str) -> str:
    if name.startswith("~/"):
        return f"/{NAME}/{name[2:]}"
    return name if name.startswith("/") else f"/{name}"


def declared(kind: str, permission: str) -> set[str]:
    [profile] = ET.parse(POLICY).getroot().iter("profile")
    assert profile.get("node") == NAME
    assert all(value == "ALLOW" for group in profile for value in group.attrib.values()), (
        "this test knows no denials"
    )
    return {
        absolute(entry.text or "")
        for group in profile.findall(f"{kind}s")
        if permission in group.attrib
        for entry in group.findall(kind)
    }


def of_action(names: set[str]) -> set[str]:
    return {name for name in names if "/_action/" in name}


def test_the_policy_is_what_the_nodes_have(
    start_node: Callable[..., Any], client: Any, tools: Any, parts: Path
) -> None:
    node = client.node
    seen: dict[str, set[str]] = {"published": set(), "subscribed": set(), "served": set()}
    ask = {
        "published": node.get_publisher_names_and_types_by_node,
        "subscribed": node.get_subscriber_names_and_types_by_node,
        "served": node.get_service_names_and_types_by_node,
    }

    def look() -> dict[str, set[str]]:
        return {what: {name for name, _ in by(NAME, "/")} for what, by in ask.items()}

    for main in ("main", "main_lifecycle"):
        process = start_node({"mesh_directories": f"[{parts}]"}, main=main)
        if main == "main_lifecycle":
            change = node.create_client(ChangeState, f"/{NAME}/change_state")
            for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
                assert change.wait_for_service(60.0)
                request = ChangeState.Request(transition=Transition(id=transition))
                future = change.call_async(request)
                tools.wait(future.done, "the transition", 60.0)
            client.in_executor(node.destroy_client, change)
        process.wait_ready()
        for what, name in (("served", "/plan_grasps_batch"), ("published", "/diagnostics")):
            tools.wait(
                lambda what=what, name=name: name in look_or_nothing(look)[what], "discovery"
            )
        for what, names in look().items():
            seen[what] |= names
        assert process.end() == 0, process.text()
        tools.wait(lambda: not look_or_nothing(look)["served"], "the node's end", 60.0)

    actions = declared("action", "execute")
    for what, kind, permission in (
        ("published", "topic", "publish"),
        ("subscribed", "topic", "subscribe"),
        ("served", "service", "reply"),
    ):
        inner = of_action(seen[what])
        assert {name.split("/_action/")[0] for name in inner} <= actions
        assert declared(kind, permission) - BY_PARAMETER == seen[what] - inner


def look_or_nothing(look: Callable[[], dict[str, set[str]]]) -> dict[str, set[str]]:
    try:
        return look()
    except Exception:  # rclpy's NodeNameNonExistentError: not seen yet, or gone
        return {"published": set(), "subscribed": set(), "served": set()}
