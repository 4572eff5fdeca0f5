"""Reading a URDF: frames, order, and what it refuses."""

import numpy as np
import pytest

from gpis_grasp_planner.errors import MeshError, RequestError
from gpis_grasp_planner.hand.link_mesh import convex_hull, write_stl
from gpis_grasp_planner.hand.urdf import read_urdf, visual_shapes

CUBE = convex_hull([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])

# The child stands before its parent, to be sorted.
TWO_LINKS = """<robot name="r">
  <link name="tip"><collision><origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/>
    <geometry><mesh filename="cube.stl"/></geometry></collision></link>
  <link name="base"><inertial><mass value="2.5"/></inertial></link>
  <joint name="j" type="{kind}"><parent link="{parent}"/><child link="tip"/>
    <origin xyz="0 0 3" rpy="0.3 -0.2 1.1"/><axis xyz="0 0 2"/>
    <limit lower="-1" upper="2" velocity="3" effort="4"/></joint>
</robot>"""


def write(folder, kind="revolute", parent="base"):
    write_stl(CUBE, folder / "cube.stl")
    path = folder / "r.urdf"
    path.write_text(TWO_LINKS.format(kind=kind, parent=parent))
    return path


def test_links_are_sorted_and_joint_facts_are_read(tmp_path):
    tree = read_urdf(write(tmp_path))
    assert tree.link_names == ("base", "tip")
    assert tree.joint_names == ("j",)
    np.testing.assert_array_equal(tree.link_parent, [-1, 0])
    np.testing.assert_array_equal(tree.link_joint, [-1, 0])
    np.testing.assert_array_equal(tree.joint_axis, [[0, 0, 0], [0, 0, 1]])  # made a unit vector
    np.testing.assert_array_equal(tree.link_mass, [2.5, 0.0])
    limits = (tree.joint_lower, tree.joint_upper, tree.joint_velocity, tree.joint_effort)
    np.testing.assert_array_equal(np.concatenate(limits), [-1, 2, 3, 4])
    np.testing.assert_array_equal(tree.joint_slides, [False])
    np.testing.assert_array_equal(read_urdf(write(tmp_path, kind="prismatic")).joint_slides, [True])


def test_rpy_turns_about_fixed_axes_x_then_y_then_z(tmp_path):
    T = read_urdf(write(tmp_path)).T_parent_joint[1]
    cx, sx, cy, sy, cz, sz = (f(a) for a in (0.3, -0.2, 1.1) for f in (np.cos, np.sin))
    Rx = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    Ry = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    Rz = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    np.testing.assert_allclose(T[:3, :3], Rz @ Ry @ Rx, atol=1e-14)
    np.testing.assert_array_equal(T[:3, 3], [0, 0, 3])


def test_collision_origin_moves_the_piece_into_the_link_frame(tmp_path):
    ((), (piece,)) = read_urdf(write(tmp_path)).link_collision
    np.testing.assert_allclose(piece.bounds, [[0, 0, 0], [1, 1, 1]], atol=1e-12)


def test_what_cannot_be_a_hand_is_refused(tmp_path):
    with pytest.raises(RequestError, match="'planar'"):
        read_urdf(write(tmp_path, kind="planar"))
    with pytest.raises(RequestError, match="do not hang on 'base'"):
        read_urdf(write(tmp_path, parent="tip"))
    with pytest.raises(RequestError, match=r"nothing\.urdf"):
        read_urdf(tmp_path / "nothing.urdf")
    path = write(tmp_path)
    path.write_text("<robot>")
    with pytest.raises(RequestError, match=r"r\.urdf"):
        read_urdf(path)
    path = write(tmp_path)
    (tmp_path / "cube.stl").unlink()
    with pytest.raises(MeshError, match=r"cube\.stl"):
        read_urdf(path)


@pytest.mark.parametrize(
    ("visual", "edges"),
    [
        ("", 1.0),  # none: the collision shape
        ('<visual><geometry><box size="2 2 2"/></geometry></visual>', 2.0),
        ('<visual><geometry><mesh filename="fine.dae"/></geometry></visual>', 1.0),
        ('<visual><geometry><cylinder radius="1" length="2"/></geometry></visual>', 2.0),
        ('<visual><geometry><capsule radius="1" length="2"/></geometry></visual>', 1.0),
    ],
)
def test_what_is_shown_is_what_can_be_read_else_the_collision_shape(tmp_path, visual, edges):
    path = write(tmp_path)
    path.write_text(path.read_text().replace('name="tip">', f'name="tip">{visual}'))
    base, [tip] = visual_shapes(path, read_urdf(path))
    assert base == ()
    np.testing.assert_allclose(np.ptp(tip.vertices, axis=0), [edges] * 3, atol=1e-12)
