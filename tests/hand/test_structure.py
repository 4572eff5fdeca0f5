"""What a hand's files may say: what was passed over in silence is refused, or taken as it is."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
import yaml
from hand_models import box_link, joint_about

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.link_mesh import MOST_CORNERS, fewest_vertices
from gpis_grasp_planner.hand.link_shapes import read_link_mesh
from gpis_grasp_planner.hand.surface_points import surface_points

BOX = box_link("left", (0.012, 0.02, 0.05), (0.0, 0.0, 0.025))


def hand_of(folder, left=BOX, more="", joint_change=("", ""), **values):
    """Two fingers of a link each; `left` and `more` URDF, and values of the YAML file."""
    text = box_link("palm", (0.08, 0.04, 0.02), (0.0, 0.0, -0.01)) + left
    text += box_link("right", (0.012, 0.02, 0.05), (0.0, 0.0, 0.025))
    for name, x, axis in (("left", -0.03, "0 1 0"), ("right", 0.03, "0 -1 0")):
        text += joint_about(name, "palm", f'xyz="{x} 0 0"', (0.0, 1.2), axis=axis)
    text = text.replace(*joint_change) if joint_change[0] else text
    (folder / "own.urdf").write_text(f'<robot name="own">{text}{more}</robot>')
    data = {
        "name": "own",
        "urdf": "own.urdf",
        "palm_link": "palm",
        "fingers": [{"name": n, "joints": [f"{n}_joint"]} for n in ("left", "right")],
        "drive": {
            "motor_names": ["left", "right"],
            "motor_upper_deg": [float(np.degrees(1.2))] * 2,
            "full_travel_s": [1.0, 1.0],
            "closing_rows": [[1.0]],
            "breakaway_torque": 0.3,
            "tip_point_mm": [6.0, 0.0, 50.0],
        },
        **values,
    }
    (folder / "own.yaml").write_text(yaml.safe_dump(data))
    load_hand.cache_clear()
    return load_hand(str(folder / "own.yaml"))


def test_a_finger_that_carries_another_joint_or_has_no_shape_is_refused(tmp_path):
    thumb = box_link("thumb", (0.01, 0.01, 0.01), (0.0, 0.0, 0.0))
    thumb += joint_about("thumb", "left", 'xyz="0 0 0.05"', (0.0, 1.0))
    with pytest.raises(RequestError, match=r"'thumb' of '.*' hangs on 'left'"):
        hand_of(tmp_path, more=thumb)
    with pytest.raises(RequestError, match=r"'left' of '.*' has no collision shape"):
        hand_of(tmp_path, left='<link name="left"/>')


def test_a_joint_of_two_fingers_is_refused(tmp_path):
    fingers = [{"name": n, "joints": ["left_joint"]} for n in ("left", "right")]
    with pytest.raises(RequestError, match="named by two fingers"):
        hand_of(tmp_path, fingers=fingers)


def test_limits_and_axes_that_are_not_given_are_those_of_urdf(tmp_path):
    hand = hand_of(tmp_path, joint_change=('lower="0.0" ', ""))
    np.testing.assert_array_equal(hand.joint_lower, [0.0, 0.0])
    hand = hand_of(tmp_path, joint_change=('<axis xyz="0 1 0"/>', ""))
    np.testing.assert_array_equal(hand.joint_axis[1], [1.0, 0.0, 0.0])
    with pytest.raises(RequestError, match="give it a direction"):
        hand_of(tmp_path, joint_change=('xyz="0 1 0"', 'xyz="0 0 0"'))


def test_a_name_without_a_link_is_refused(tmp_path):
    with pytest.raises(RequestError, match="Palm"):
        hand_of(tmp_path, palm_friction_links=["Palm"])


@pytest.mark.parametrize(("turn", "ok"), [(np.pi, True), (0.0, False)])
def test_coupled_jaws_are_told_by_their_axes_in_the_palm(tmp_path, turn, ok):
    """Each jaw slides along x of a mount of its own; one mount is turned, or is not."""
    mounts = "".join(
        box_link(f"{name}_mount", (0.01, 0.01, 0.01), (0.0, 0.0, 0.0))
        + f'<joint name="{name}_mount_joint" type="fixed"><parent link="palm"/>'
        + f'<child link="{name}_mount"/><origin xyz="{x} 0 0" rpy="0 0 {z}"/></joint>'
        for name, x, z in (("left", -0.04, 0.0), ("right", 0.04, turn))
    )
    jaws = "".join(
        box_link(name, (0.01, 0.02, 0.05), (0.0, 0.0, 0.03))
        + joint_about(name, f"{name}_mount", "", (0.0, 0.03), kind="prismatic", axis="1 0 0")
        for name in ("left", "right")
    )
    palm = box_link("palm", (0.08, 0.04, 0.02), (0.0, 0.0, -0.01))
    drive = {
        "motor_names": ["left", "right"],
        "motor_upper_mm": [30.0, 30.0],
        "full_travel_s": [1.0, 1.0],
        "closing_rows": [[1.0]],
        "breakaway_torque": 0.3,
        "tip_point_mm": [5.0, 0.0, 50.0],
        "coupled": True,
    }
    (tmp_path / "jaws.urdf").write_text(f'<robot name="jaws">{palm}{mounts}{jaws}</robot>')
    if ok:
        assert hand_of(tmp_path, urdf="jaws.urdf", drive=drive).drive.coupled
    else:
        with pytest.raises(RequestError, match="slide towards each other"):
            hand_of(tmp_path, urdf="jaws.urdf", drive=drive)


def test_control_elements_are_no_joints_of_the_tree(tmp_path):
    more = '<ros2_control name="c"><joint name="left_joint"/></ros2_control>'
    assert hand_of(tmp_path, more=more, palm_axis=[0, 0, -1]).n_joints == 2


def test_a_visual_mesh_that_is_not_there_is_not_in_the_way(tmp_path):
    shown = '<visual><geometry><mesh filename="gone.dae"/></geometry></visual></link>'
    hand = hand_of(tmp_path, left=BOX.replace("</link>", shown))
    assert len(hand.digest) == 64
    assert hand.identity.endswith(hand.digest[:16])


def test_a_hand_keeps_the_hash_of_the_files_it_was_read_from(tmp_path):
    hand = hand_of(tmp_path)
    before = hand.identity
    hand.urdf_path.write_text(hand.urdf_path.read_text().replace("0.012", "0.030"))
    assert hand.identity == before
    load_hand.cache_clear()
    assert load_hand(str(hand.yaml_path)).identity != before


def test_links_that_share_a_mesh_have_the_fine_side_of_their_own_contacts(tmp_path):
    box = trimesh.creation.box((0.012, 0.02, 0.05))
    box.apply_translation([0.0, 0.0, 0.025])
    box.export(tmp_path / "x.stl")
    mesh = '<collision><geometry><mesh filename="x.stl"/></geometry></collision></link>'
    link = '<link name="left"><inertial><mass value="0.04"/></inertial>' + mesh
    right = box_link("right", (0.012, 0.02, 0.05), (0.0, 0.0, 0.025))
    hand = hand_of(tmp_path, left=link, joint_change=(right, link.replace("left", "right")))
    points = surface_points(hand)
    counts = []
    for side, name in ((1.0, "left"), (-1.0, "right")):
        of_link = points.links == hand.link_names.index(name)
        counts.append(int((of_link & (side * points.normals_outward[:, 0] > 0.99)).sum()))
    assert counts[0] == counts[1] > 10


def test_an_open_collision_mesh_is_refused_and_faces_without_area_are_dropped(tmp_path):
    box = trimesh.creation.box((0.012, 0.02, 0.05))
    link = '<link name="left"><collision><geometry><mesh filename="x.stl"/></geometry></collision>'
    trimesh.Trimesh(box.vertices, box.faces[1:], process=False).export(tmp_path / "x.stl")
    with pytest.raises(RequestError, match="not closed"):
        hand_of(tmp_path, left=link + "</link>")
    assert len(hand_of(tmp_path, left=link + "</link>", collision_hulls=True).link_collision) == 3
    faces = np.concatenate([box.faces, [[0, 0, 1]]])
    trimesh.Trimesh(box.vertices, faces, process=False).export(tmp_path / "x.stl")
    assert len(read_link_mesh(tmp_path / "x.stl").faces) == 12
    hand_of(tmp_path, left=link + "</link>")


@pytest.mark.parametrize(
    "shape", ['<cylinder radius="0.01"/>', '<sphere radius="0"/>', '<box size="0 1 1"/>']
)
def test_a_shape_without_a_volume_is_refused(tmp_path, shape):
    left = f'<link name="left"><collision><geometry>{shape}</geometry></collision></link>'
    with pytest.raises(RequestError, match="above 0"):
        hand_of(tmp_path, left=left)


@pytest.mark.parametrize("end", ["upper_mm", "upper_deg"])
def test_the_ends_of_a_pre_shape_have_the_unit_of_its_joints(tmp_path, end):
    kind = "revolute" if end == "upper_mm" else "prismatic"
    more = box_link("knob", (0.01, 0.01, 0.01), (0.0, 0.0, 0.0))
    more += joint_about("knob", "palm", 'xyz="0 0.03 0"', (0.0, 0.5), kind=kind)
    motor = {"name": "turn", "joints": {"knob_joint": 1.0}, end: 40, "full_travel_s": 1.0}
    with pytest.raises(RequestError, match=r"give (mm|degrees)"):
        hand_of(tmp_path, more=more, preshape=[motor])


def test_a_hull_that_qhull_cannot_grow_has_as_many_corners_as_there_is_room(rng):
    a = 0.05
    flat = [(a, 0, a), (-a, 0, -a), (0, a, 0), (0, -a, 0)]  # the extremes lie on one plane
    ball = rng.standard_normal((600, 3))
    ball *= 0.9 * a / np.linalg.norm(ball, axis=1, keepdims=True)
    points = np.concatenate([flat, ball])
    assert len(fewest_vertices(points, 5e-5)) > MOST_CORNERS
    kept = fewest_vertices(points, 5e-5, MOST_CORNERS)
    assert 100 < len(kept) <= MOST_CORNERS
    np.testing.assert_array_equal(np.ptp(kept, axis=0), np.ptp(points, axis=0))
