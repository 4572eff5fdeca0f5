"""Markers show the hand where the kinematics put it, and the contacts where they are."""

from __future__ import annotations

import dataclasses
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose, Vector3
from visualization_msgs.msg import Marker

from gpis_grasp_msgs.msg import Contact, Grasp, GraspVerification
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.hand.description import load_hand, urdf_text
from gpis_grasp_planner.hand.fixed_links import FixedFrame
from gpis_grasp_planner.ros.markers import NORMAL_LENGTH_M, GraspMarkers, ShownPart
from gpis_grasp_planner.ros.quality_color import FELL, HELD, NOT_TRIED

HAND = load_hand()


def grasp() -> Grasp:
    message = Grasp()
    message.palm_pose.header.frame_id = "map"
    message.palm_pose.pose.position.z = 1.0
    message.grasp.name = list(HAND.joint_names)
    message.grasp.position = [0.0] * 8
    message.contacts = [
        Contact(
            link="bh_palm_link",
            position=Point(x=0.1, y=0.2, z=0.3),
            normal_inward=Vector3(x=0.0, y=0.0, z=1.0),
            friction=0.6,
        )
    ]
    return message


def test_every_visual_mesh_of_the_urdf_is_shown_once() -> None:
    urdf = urdf_text(HAND)
    markers = GraspMarkers(HAND, urdf).array([grasp()]).markers
    assert markers[0].action == Marker.DELETEALL
    hand = [m for m in markers if m.ns == "hand"]
    in_urdf = [m.get("filename") for m in ET.fromstring(urdf).iterfind("link/visual/geometry/mesh")]
    assert sorted(m.mesh_resource for m in hand) == sorted(in_urdf)
    assert all(m.header.frame_id == "map" for m in markers)
    assert len({(m.ns, m.id) for m in markers[1:]}) == len(markers) - 1
    # Palm pieces lie in the palm frame; F1's inner joint is 33.9 mm above the knuckle's frame.
    palm = [m for m in hand if "palm_" in m.mesh_resource]
    assert len(palm) == 3
    assert all(np.isclose(m.pose.position.z, 1.0) for m in palm)
    inner = [m for m in hand if "inner_link" in m.mesh_resource]
    assert np.allclose([m.pose.position.z for m in inner], 1.0 + 0.0754)


def test_the_arrow_ends_at_the_contact_and_points_inward() -> None:
    markers = GraspMarkers(HAND, urdf_text(HAND)).array([grasp()]).markers
    [sphere] = [m for m in markers if m.ns == "contacts"]
    [arrow] = [m for m in markers if m.ns == "normals_inward"]
    assert sphere.pose.position == Point(x=0.1, y=0.2, z=0.3)
    tail, head = arrow.points
    assert head == sphere.pose.position
    assert np.isclose(head.z - tail.z, NORMAL_LENGTH_M)


def test_boxes_of_a_hand_are_shown_where_the_urdf_has_them() -> None:
    hand = load_hand("parallel_jaw")
    message = grasp()
    message.grasp.name = list(hand.joint_names)
    message.grasp.position = [0.0] * hand.n_joints
    urdf = urdf_text(hand)
    markers = [m for m in GraspMarkers(hand, urdf).array([message]).markers if m.ns == "hand"]
    assert len(markers) == len(ET.fromstring(urdf).findall("link/visual/geometry/box")) > 0
    assert {m.type for m in markers} == {Marker.CUBE}
    base = markers[
        0
    ]  # the palm link's first: 76 x 76 x 62 mm, its middle 31 mm above the palm frame
    assert [base.scale.x, base.scale.y, base.scale.z] == [0.076, 0.076, 0.062]
    assert np.isclose(base.pose.position.z, 1.031)


def test_a_link_that_is_one_body_with_another_is_drawn_where_that_takes_it() -> None:
    outer = load_hand("parallel_jaw").link_names[-1]
    T = transform(np.eye(3), [0.0, 0.0, 0.2])
    hand = dataclasses.replace(
        load_hand("parallel_jaw"), fixed_frames=(FixedFrame("tip", outer, T),)
    )
    look = '<visual><geometry><sphere radius="0.01"/></geometry></visual>'
    urdf = (
        f'<robot name="r"><link name="{outer}">{look}</link><link name="tip">{look}</link></robot>'
    )
    message = grasp()
    message.grasp.position = [0.01] * hand.n_joints
    carrier, tip = (
        m.pose.position for m in GraspMarkers(hand, urdf).array([message]).markers if m.ns == "hand"
    )
    apart = np.array([tip.x - carrier.x, tip.y - carrier.y, tip.z - carrier.z])
    assert np.linalg.norm(apart) == pytest.approx(0.2)


def test_lifetime_header_and_names_of_all_markers() -> None:
    better, worse = grasp(), grasp()
    worse.pre_grasp_palm_pose.pose.position.x = -0.1
    part = ShownPart(Pose(position=Point(x=0.4)), "file:///tmp/part.stl", 1e-3)
    clear, *markers = GraspMarkers(HAND, urdf_text(HAND)).array([better, worse], part, 2.25).markers
    assert clear.action == Marker.DELETEALL
    assert {(m.lifetime.sec, m.lifetime.nanosec) for m in markers} == {(2, 250_000_000)}
    assert {m.header.frame_id for m in markers} == {"map"}
    assert len({(m.ns, m.id) for m in markers}) == len(markers)
    assert {m.ns for m in markers} == {
        "part", "hand", "contacts", "normals_inward", "way", "ways", "figures",
    }  # fmt: skip
    [shown] = [m for m in markers if m.ns == "part"]
    assert (shown.mesh_resource, shown.pose.position.x) == ("file:///tmp/part.stl", 0.4)
    assert shown.scale == Vector3(x=1e-3, y=1e-3, z=1e-3)
    [way] = [m for m in markers if m.ns == "ways"]
    assert way.points == [Point(x=-0.1), Point(z=1.0)]
    [text] = [m for m in markers if m.ns == "figures"]
    assert "not tried" in text.text


def tried(held: bool, probability: float = -1.0) -> Grasp:
    message = grasp()
    message.verification = GraspVerification(attempted=True, held=held, probability=probability)
    return message


@pytest.mark.parametrize(
    ("message", "color"),
    [
        (grasp(), NOT_TRIED),
        (tried(False), FELL),
        (tried(False, 0.9), FELL),  # what fell is red, whatever an estimate says
        (tried(True), HELD),
        (tried(True, 1.0), HELD),
        (tried(True, 0.0), FELL),
    ],
)
def test_hand_and_way_have_the_colour_of_what_physics_said(
    message: Grasp, color: tuple[float, float, float]
) -> None:
    markers = GraspMarkers(HAND, urdf_text(HAND)).array([message]).markers
    for marker in markers:
        if marker.ns in ("hand", "way"):
            shown = marker.color
            assert np.allclose([shown.r, shown.g, shown.b], color)


def test_the_likelier_it_holds_the_greener_and_the_less_red() -> None:
    markers = GraspMarkers(HAND, urdf_text(HAND))
    ways = markers.array([tried(True, p) for p in (0.0, 0.3, 0.5, 0.7, 1.0)]).markers
    colors = [m.color for m in ways if m.ns in ("way", "ways")]
    share_of_green = [c.g / (c.g + c.r) for c in colors]
    assert share_of_green == sorted(share_of_green)
    assert len(set(share_of_green)) == 5
