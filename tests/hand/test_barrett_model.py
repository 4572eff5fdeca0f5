"""The shipped URDF and meshes: fresh, convex, physically possible, free of self-contact."""

import itertools
from xml.etree import ElementTree as ET

import coal
import numpy as np
import pytest

from gpis_grasp_planner.hand.barrett_model import (
    PALM_CENTER_M,
    PALM_INERTIA,
    PALM_MASS_KG,
    write_model,
)
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.drive import joints_from_motors
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.link_shapes import read_link_mesh

PIECES = [
    (name, index)
    for name, pieces in zip(load_hand().link_names, load_hand().link_collision, strict=True)
    for index in range(len(pieces))
]


def inertials():
    """Mass, centre and inertia by link name, read from the shipped URDF."""
    found = {}
    for link in ET.parse(load_hand().urdf_path).getroot().findall("link"):
        entries = link.find("inertial/inertia").attrib
        I = np.zeros((3, 3))  # noqa: E741
        for key, value in entries.items():
            i, j = ("xyz".index(axis) for axis in key[1:])
            I[i, j] = I[j, i] = float(value)
        center = np.array(link.find("inertial/origin").get("xyz").split(), dtype=float)
        found[link.get("name")] = (float(link.find("inertial/mass").get("value")), center, I)
    return found


def test_the_shipped_files_are_what_the_generator_writes(tmp_path):
    write_model(tmp_path)
    shipped = load_hand().urdf_path.parent
    written = sorted(p.relative_to(tmp_path) for p in tmp_path.rglob("*") if p.is_file())
    assert len(written) == 9
    for name in written:
        if name.suffix == ".urdf":
            assert (tmp_path / name).read_bytes() == (shipped / name).read_bytes()
        else:
            # Hulls may list their faces in another order on another SciPy.
            fresh, kept = read_link_mesh(tmp_path / name), read_link_mesh(shipped / name)
            assert len(fresh.faces) == len(kept.faces)
            np.testing.assert_allclose(fresh.vertices, kept.vertices, atol=1e-8)


def test_urdf_has_the_mimic_tags_and_no_collision_but_meshes():
    robot = ET.parse(load_hand().urdf_path).getroot()
    mimic = {
        joint.get("name"): (m.get("joint"), float(m.get("multiplier")))
        for joint in robot.findall("joint")
        if (m := joint.find("mimic")) is not None
    }
    assert set(mimic) == {"bh_j21_joint", "bh_j13_joint", "bh_j23_joint", "bh_j33_joint"}
    assert mimic["bh_j21_joint"] == ("bh_j11_joint", 1.0)
    for finger in "123":
        assert mimic[f"bh_j{finger}3_joint"] == (f"bh_j{finger}2_joint", pytest.approx(1 / 3))
    for link in robot.findall("link"):
        collision = [mesh.get("filename") for mesh in link.findall("collision/geometry/mesh")]
        visual = [mesh.get("filename") for mesh in link.findall("visual/geometry/mesh")]
        assert collision == visual
        assert len(collision) == len(link.findall("collision")) > 0


@pytest.mark.parametrize("name", load_hand().link_names)
def test_inertia_is_that_of_a_possible_body(name):
    mass, _, inertia = inertials()[name]
    assert mass > 0.0
    a, b, c = np.linalg.eigvalsh(inertia)
    assert a > 0.0
    assert a + b > c  # triangle inequality of principal moments


def test_palm_and_third_fingers_block_together_have_the_measured_figures():
    bodies = inertials()
    T = link_transforms(load_hand(), np.zeros(8))[0]
    total, moment, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    parts = []
    for link, name in ((0, "bh_palm_link"), (3, "bh_finger_3_knuckle_link")):
        mass, center, I_own = bodies[name]
        R = T[link, :3, :3]
        parts.append((mass, R @ center + T[link, :3, 3], R @ I_own @ R.T))
        total, moment = total + mass, moment + mass * parts[-1][1]
    for mass, center, I_own in parts:
        d = center - moment / total
        inertia += I_own + mass * (d @ d * np.eye(3) - np.outer(d, d))
    assert total == pytest.approx(PALM_MASS_KG, abs=1e-9)
    np.testing.assert_allclose(moment / total, PALM_CENTER_M, atol=1e-9)
    np.testing.assert_allclose(inertia, PALM_INERTIA, atol=1e-10)


@pytest.mark.parametrize(("name", "index"), PIECES)
def test_collision_piece_is_closed_and_convex(name, index):
    hand = load_hand()
    piece = hand.link_collision[hand.link_names.index(name)][index]
    assert 8 <= len(piece.vertices) <= 150
    half = np.sort(piece.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(half, axis=0, return_counts=True)[1] == 2).all()
    assert len(piece.vertices) - len(half) // 2 + len(piece.faces) == 2  # Euler
    normal = piece.face_normals_outward
    height = piece.vertices @ normal.T - np.einsum("ij,ij->i", normal, piece.triangles[:, 0])
    assert height.max() < 1e-7  # float32 in the file


def test_link_shapes_have_the_quoted_extents():
    """Fact sheet, millimetres, each in its link's frame."""
    hand = load_hand()
    quoted = {
        ("bh_palm_link", 0): ((-44.5, -44.5, 0.0), (44.5, 44.5, 41.5)),
        ("bh_palm_link", 2): ((-44.5, -35.0, 66.3), (44.5, 26.5, 79.3)),
        ("bh_finger_1_inner_link", 0): ((-12.5, -12.5, -10.5), (79.44, 15.0, 10.5)),
        ("bh_finger_1_distal_link", 0): ((-9.5, -9.74, -11.5), (59.0, 11.0, 11.5)),
    }
    for (name, index), (lower, upper) in quoted.items():
        bounds = 1000 * hand.link_collision[hand.link_names.index(name)][index].bounds
        np.testing.assert_allclose(bounds, [lower, upper], atol=0.01)
    knuckle = np.vstack([p.vertices for p in hand.link_collision[1]]) * 1000
    np.testing.assert_allclose(knuckle.min(axis=0), [-12.3, -12.3, -5.0], atol=0.01)
    np.testing.assert_allclose(knuckle.max(axis=0), [65.0, 12.3, 48.9], atol=0.01)
    block = hand.link_collision[3][0].vertices * 1000  # along the finger is y of the palm
    assert block[:, 0].min() == pytest.approx(27.0, abs=0.01)
    assert block[:, 0].max() == pytest.approx(65.0, abs=0.01)
    assert block[:, 2].max() + 41.5 == pytest.approx(90.4, abs=0.01)


def clearance_mm(joints):
    """Smallest distance [mm] between links that do not share a joint, by name pair."""
    hand = load_hand()
    shapes = []
    for pieces in hand.link_collision:
        shapes.append([])
        for piece in pieces:
            points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
            points.extend(list(piece.vertices))
            faces.extend([coal.Triangle(*map(int, face)) for face in piece.faces])
            shapes[-1].append(coal.Convex(points, faces))
    T = [coal.Transform3s(t[:3, :3], t[:3, 3]) for t in link_transforms(hand, joints)[0]]
    worst = {}
    for a, b in itertools.combinations(range(hand.n_links), 2):
        if hand.link_parent[a] == b or hand.link_parent[b] == a:
            continue
        distance = min(
            coal.distance(x, T[a], y, T[b], coal.DistanceRequest(), coal.DistanceResult())
            for x, y in itertools.product(shapes[a], shapes[b])
        )
        worst[hand.link_names[a], hand.link_names[b]] = 1000 * distance
    return worst


@pytest.mark.parametrize("spread_deg", [0, 45, 90, 135, 180])
def test_the_open_hand_does_not_touch_itself(spread_deg):
    q = joints_from_motors(load_hand(), np.radians([[spread_deg]]), np.zeros((1, 3)))
    assert min(clearance_mm(q).values()) > 0.35


@pytest.mark.parametrize("motor_deg", [60.0, 85.5, 100.0, 120.0, 140.0])
def test_opposed_fingers_pass_each_other_over_the_whole_travel(motor_deg):
    hand = load_hand()
    q = joints_from_motors(hand, [0.0], np.radians([[motor_deg] * 3]))
    found = clearance_mm(q)
    assert min(found.values()) > 0.5
    if motor_deg >= 100.0:  # here they overlap seen from the side: 2 mm each side
        between = found["bh_finger_1_distal_link", "bh_finger_3_distal_link"]
        assert motor_deg > 130.0 or 1.9 < between < 3.1
