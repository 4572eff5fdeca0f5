"""Links fixed to others go with their carriers: against Bullet, and against one body by hand."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
import pybullet
import pytest
import yaml
from hand_models import box_link, joint_about
from pybullet_utils.bullet_client import BulletClient

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.transforms import apply, from_position_quat_xyzw
from gpis_grasp_planner.hand.checks import faults_of
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.fixed_links import fold_fixed_links
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.urdf import visual_shapes

PALM = box_link("palm", (0.08, 0.04, 0.02), (0.0, 0.0, -0.01))
ENDS = (0.0, 1.2)


def fixed(link, parent, origin):
    return (
        f'<joint name="{link}_fixed" type="fixed"><parent link="{parent}"/><child link="{link}"/>'
        f"<origin {origin}/></joint>"
    )


def hand_of(folder, body, **values):
    """A hand of two fingers of two links each, by the URDF text of its links and joints."""
    folder.mkdir(exist_ok=True)
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'  # for Bullet
    body = body.replace("</inertial>", inertia)
    (folder / "own.urdf").write_text(f'<robot name="own">{body}</robot>')
    data = {
        "name": "own",
        "urdf": "own.urdf",
        "palm_link": "palm",
        "fingers": [
            {"name": side, "joints": [f"{side}_joint", f"{side}_far_joint"]}
            for side in ("left", "right")
        ],
        "drive": {
            "motor_names": ["left", "right"],
            "motor_upper_deg": [float(np.degrees(1.2))] * 2,
            "full_travel_s": [1.0, 1.0],
            "closing_rows": [[1.0, 1.0], [0.0, 1.0]],
            "breakaway_torque": 0.3,
            "tip_point_mm": [6.0, 0.0, 40.0],
        },
        **values,
    }
    (folder / "own.yaml").write_text(yaml.safe_dump(data))
    load_hand.cache_clear()
    return load_hand(str(folder / "own.yaml"))


def fingers(parent, z):
    """URDF text of two fingers of two links at a height on their parent [m]."""
    text = ""
    for side, x in (("left", -0.03), ("right", 0.03)):
        text += box_link(side, (0.012, 0.02, 0.04), (0.0, 0.0, 0.02))
        text += joint_about(side, parent, f'xyz="{x} 0 {z}"', ENDS, axis="0 1 0")
        text += box_link(f"{side}_far", (0.012, 0.02, 0.03), (0.0, 0.0, 0.015))
        text += joint_about(f"{side}_far", side, 'xyz="0 0 0.04"', ENDS, axis="0 1 0")
    return text


def split_hand(folder):
    """Its fingers stand on bare mounts, have a turned bracket between the links, and a tip."""
    text = PALM + '<link name="tcp"/>' + fixed("tcp", "palm", 'xyz="0 0 0.1"')
    text += box_link("camera", (0.01, 0.02, 0.01), (0.0, 0.0, 0.0))
    text += fixed("camera", "palm", 'xyz="0 0.03 0" rpy="0.3 0 0"')
    for side, x, turn in (("left", -0.03, 0.0), ("right", 0.03, np.pi)):
        text += f'<link name="{side}_mount"/>'
        text += fixed(f"{side}_mount", "palm", f'xyz="{x} 0 0" rpy="0 0 {turn}"')
        text += box_link(side, (0.012, 0.02, 0.04), (0.0, 0.0, 0.02))
        text += joint_about(side, f"{side}_mount", "", ENDS, axis="0 1 0")
        text += box_link(f"{side}_bracket", (0.01, 0.01, 0.006), (0.0, 0.0, 0.003))
        text += fixed(f"{side}_bracket", side, 'xyz="0 0 0.04" rpy="0 0 0.7"')
        text += box_link(f"{side}_far", (0.012, 0.02, 0.03), (0.0, 0.0, 0.015))
        origin = 'xyz="0 0 0.006" rpy="0 0 -0.7"'
        text += joint_about(f"{side}_far", f"{side}_bracket", origin, ENDS, axis="0 1 0")
        text += box_link(f"{side}_tip", (0.01, 0.01, 0.01), (0.0, 0.0, 0.005))
        text += fixed(f"{side}_tip", f"{side}_far", 'xyz="0.001 0 0.03" rpy="0.2 -0.4 0.5"')
        text += f'<link name="{side}_pad"/>'
        text += fixed(f"{side}_pad", f"{side}_tip", 'xyz="0 0 0.01" rpy="0 0.1 0"')
    return hand_of(folder, text)


@pytest.fixture
def bullet():
    client = BulletClient(connection_mode=pybullet.DIRECT)
    yield client
    client.disconnect()


def test_links_and_frames_are_where_bullet_has_them(bullet, tmp_path, rng):
    hand = split_hand(tmp_path)
    assert hand.link_names == ("palm", "camera", "left", "right", "left_far", "right_far")
    body = bullet.loadURDF(str(hand.urdf_path), useFixedBase=True)
    local = bullet.getDynamicsInfo(body, -1)[3:5]
    bullet.resetBasePositionAndOrientation(body, *local)
    infos = [bullet.getJointInfo(body, i) for i in range(bullet.getNumJoints(body))]
    index = {info[12].decode(): info[0] for info in infos}
    assert {*index, "palm"} == {*hand.link_names, *(frame.name for frame in hand.fixed_frames)}
    for q in rng.uniform(hand.joint_lower, hand.joint_upper, (5, 4)):
        for name, angle in zip(hand.joint_names, q, strict=True):
            bullet.resetJointState(body, index[name.removesuffix("_joint")], angle)
        T_palm = dict(zip(hand.link_names, link_transforms(hand, q)[0], strict=True))
        for frame in hand.fixed_frames:
            T_palm[frame.name] = T_palm[frame.carrier] @ frame.T_carrier_frame
        for name, link in index.items():
            state = bullet.getLinkState(body, link, computeForwardKinematics=True)
            T_bullet = from_position_quat_xyzw(state[4], state[5])
            np.testing.assert_allclose(T_palm[name], T_bullet, atol=2e-6)


def test_shapes_and_masses_are_those_of_the_bodies(tmp_path):
    hand = split_hand(tmp_path)
    assert faults_of(hand) == []
    np.testing.assert_allclose(hand.link_mass, [0.04, 0.04, 0.08, 0.08, 0.08, 0.08])
    raw = {link.get("name"): link for link in ET.parse(hand.urdf_path).getroot().findall("link")}
    T_of = {frame.name: frame.T_carrier_frame for frame in hand.fixed_frames}
    for carrier, child in (("left", "left_bracket"), ("right_far", "right_tip")):
        own, put = hand.link_collision[hand.link_names.index(carrier)]
        size = [float(x) for x in raw[child].find("collision/geometry/box").get("size").split()]
        center = [float(x) for x in raw[child].find("collision/origin").get("xyz").split()]
        back = apply(np.linalg.inv(T_of[child]), put.vertices)
        np.testing.assert_allclose(back.min(axis=0), np.array(center) - np.array(size) / 2)
        np.testing.assert_allclose(back.max(axis=0), np.array(center) + np.array(size) / 2)
        assert own.vertices.max() > 0.0


def test_it_is_the_hand_that_has_the_shapes_in_its_links(tmp_path):
    """Without turns between them the bodies can be written by hand, number by number."""
    split = whole = PALM
    for side, x in (("left", -0.03), ("right", 0.03)):
        split += f'<link name="{side}_mount"/>' + fixed(f"{side}_mount", "palm", f'xyz="{x} 0 0"')
        split += box_link(side, (0.012, 0.02, 0.04), (0.0, 0.0, 0.02))
        split += joint_about(side, f"{side}_mount", "", ENDS, axis="0 1 0")
        whole += box_link(side, (0.012, 0.02, 0.04), (0.0, 0.0, 0.02))
        whole += joint_about(side, "palm", f'xyz="{x} 0 0"', ENDS, axis="0 1 0")
        far = box_link(f"{side}_far", (0.012, 0.02, 0.03), (0.0, 0.0, 0.015))
        tip = box_link(f"{side}_tip", (0.01, 0.01, 0.01), (0.0, 0.0, 0.005))
        joint = joint_about(f"{side}_far", side, 'xyz="0 0 0.04"', ENDS, axis="0 1 0")
        split += far + joint + tip + fixed(f"{side}_tip", f"{side}_far", 'xyz="0 0 0.03"')
        shape = '<collision><origin xyz="0 0 0.035"/>' + tip[tip.index("<geometry>") :]
        whole += far.replace("0.04", "0.08").replace("</link>", shape) + joint
    a, b = hand_of(tmp_path / "split", split), hand_of(tmp_path / "whole", whole)
    assert a.link_names == b.link_names
    np.testing.assert_array_equal(a.link_mass, b.link_mass)
    np.testing.assert_array_equal(a.T_parent_joint, b.T_parent_joint)
    for of_a, of_b in zip(a.link_collision, b.link_collision, strict=True):
        assert len(of_a) == len(of_b)
        for piece, other in zip(of_a, of_b, strict=True):
            np.testing.assert_allclose(piece.vertices, other.vertices, atol=1e-15)
    np.testing.assert_allclose(a.desired_contacts.points, b.desired_contacts.points, atol=1e-15)


def test_a_palm_without_shapes_takes_the_first_that_is_fixed_to_it(tmp_path):
    text = '<link name="palm"/>' + box_link("body", (0.08, 0.04, 0.02), (0.0, 0.0, 0.0))
    text += fixed("body", "palm", 'xyz="0 0 -0.01"')
    text += fingers("body", 0.01)
    hand = hand_of(tmp_path, text)
    [solid] = hand.link_collision[0]
    np.testing.assert_allclose(solid.vertices[:, 2].max(), 0.0, atol=1e-15)
    np.testing.assert_allclose(hand.T_parent_joint[1][:3, 3], [-0.03, 0.0, 0.0], atol=1e-15)


def test_what_is_drawn_goes_with_it(tmp_path):
    """The tip alone has looks: the link that carries it is seen by its solid shape beside them."""
    look = '<visual><geometry><sphere radius="0.004"/></geometry></visual></link>'
    tip = box_link("left_tip", (0.01, 0.01, 0.01), (0.0, 0.0, 0.005)).replace("</link>", look)
    text = PALM + tip + fixed("left_tip", "left_far", 'xyz="0 0 0.03"')
    text += fingers("palm", 0.0)
    hand = hand_of(tmp_path, text)
    solid, ball = visual_shapes(hand.urdf_path, hand)[hand.link_names.index("left_far")]
    np.testing.assert_allclose(np.ptp(solid.vertices, axis=0), [0.012, 0.02, 0.03])
    np.testing.assert_allclose(ball.vertices.mean(axis=0), [0.0, 0.0, 0.03], atol=1e-9)
    assert np.linalg.norm(ball.vertices - [0.0, 0.0, 0.03], axis=1) == pytest.approx(0.004)


def test_links_in_a_ring_or_without_a_carrier_are_told_of(tmp_path):
    ring = fixed("a", "b", "") + fixed("b", "a", "")
    with pytest.raises(RequestError, match="do not hang on"):
        hand_of(tmp_path, PALM + box_link("a", (1, 1, 1), (0, 0, 0)) + '<link name="b"/>' + ring)
    with pytest.raises(RequestError, match="do not hang on"):
        hand_of(tmp_path, PALM + '<link name="a"/>' + fixed("a", "nowhere", ""))


def test_links_with_shapes_on_the_palm_stay_links():
    for name in ("barrett_bh280", "three_finger_adaptive"):
        robot = ET.parse(load_hand(name).urdf_path).getroot()
        before = ET.tostring(robot)
        assert fold_fixed_links(robot) == ()
        assert ET.tostring(robot) == before
