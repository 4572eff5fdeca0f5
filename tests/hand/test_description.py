"""The hand's data: names, tree, limits, span from the geometry, desired contacts."""

import numpy as np
import pytest

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.transforms import apply
from gpis_grasp_planner.hand.description import available_hands, load_hand, urdf_text
from gpis_grasp_planner.hand.kinematics import link_transforms

SPREAD, INNER = ["bh_j11_joint", "bh_j21_joint"], ["bh_j12_joint", "bh_j22_joint", "bh_j32_joint"]
DISTAL = ["bh_j13_joint", "bh_j23_joint", "bh_j33_joint"]


def test_joint_names_and_limits_are_those_of_the_fact_sheet():
    hand = load_hand()
    assert list(hand.joint_names) == SPREAD + INNER + DISTAL
    np.testing.assert_array_equal(hand.joint_lower, 0.0)
    np.testing.assert_allclose(
        np.degrees(hand.joint_upper), [180, 180, 140, 140, 140, 48, 48, 48], atol=1e-9
    )
    # Inner joints 140 deg/s; distal joints four thirds of it after breakaway; spread 360 deg/s.
    np.testing.assert_allclose(
        np.degrees(hand.joint_velocity), [360, 360, *[140] * 3, *[560 / 3] * 3], atol=1e-6
    )
    assert (hand.joint_effort > 0).all()


def test_the_tree_hangs_on_the_palm_with_parents_first():
    hand = load_hand()
    assert hand.palm_link == hand.link_names[0] == "bh_palm_link"
    assert hand.link_parent[0] == -1
    assert all(hand.link_parent[i] < i for i in range(1, hand.n_links))
    assert sorted(hand.link_joint[hand.link_joint >= 0]) == list(range(8))
    for number, finger in enumerate(hand.fingers, start=1):
        assert hand.link_names[finger.knuckle_link] == f"bh_finger_{number}_knuckle_link"
        assert hand.link_names[finger.inner_link] == f"bh_finger_{number}_inner_link"
        assert hand.link_names[finger.distal_link] == f"bh_finger_{number}_distal_link"
        assert hand.link_joint[finger.distal_link] == finger.distal_joint
    assert hand.preshape.names == ("spread",)
    np.testing.assert_array_equal(hand.preshape.gain, [[1.0, 1.0]])


def test_only_the_palm_and_the_third_fingers_block_have_the_palms_friction():
    hand = load_hand()
    palm_like = [
        name
        for name, group in zip(hand.link_names, hand.link_friction_group, strict=True)
        if group == "palm"
    ]
    assert palm_like == ["bh_palm_link", "bh_finger_3_knuckle_link"]


def test_the_open_hand_spans_334_6_nail_to_nail_and_304_3_tip_to_tip():
    hand = load_hand()
    T = link_transforms(hand, np.zeros(8))[0]
    tip = np.array([[0.050, 0.0095, 0.0]])
    nail, tips = [], []
    for finger in (hand.fingers[0], hand.fingers[2]):
        (piece,) = hand.link_collision[finger.distal_link]
        nail.append(np.abs(apply(T[finger.distal_link], piece.vertices)[:, 1]).max())
        tips.append(abs(apply(T[finger.distal_link], tip)[0, 1]))
    assert 1000 * sum(nail) == pytest.approx(334.6, abs=0.05)
    assert 1000 * sum(tips) == pytest.approx(304.3, abs=0.05)


def test_masses_add_up_to_the_whole_hand():
    assert load_hand().link_mass.sum() == pytest.approx(1.200, abs=1e-9)


def test_desired_contacts_lie_on_the_links_and_look_out_of_them():
    hand = load_hand()
    wanted = hand.desired_contacts
    assert np.count_nonzero(wanted.links == 0) == 4
    for finger in hand.fingers:
        on_finger = np.isin(wanted.links, [finger.inner_link, finger.distal_link])
        assert np.count_nonzero(on_finger) == 5
    np.testing.assert_allclose(np.linalg.norm(wanted.normals, axis=1), 1.0, atol=1e-12)
    for link, point, normal in zip(wanted.links, wanted.points, wanted.normals, strict=True):
        best = []
        for piece in hand.link_collision[link]:
            face_normal = piece.face_normals_outward
            height = np.einsum("ij,ij->i", face_normal, point - piece.triangles[:, 0])
            top = int(np.argmax(height))
            best.append((abs(height[top]), face_normal[top] @ normal))
        distance, cosine = min(best)
        assert distance < 2e-6
        assert cosine > 0.9999


def test_eigengrasps_are_spread_and_three_fingers_together():
    eigen = load_hand().eigengrasps
    np.testing.assert_array_equal(eigen.origin, [1.13, 0.79, 0.79, 0.79])
    np.testing.assert_array_equal(eigen.directions, [[1, 0, 0, 0], [0, 1, 1, 1]])


def test_a_hand_is_loaded_once_and_cannot_be_changed():
    hand = load_hand()
    assert load_hand("barrett_bh280") is load_hand("barrett_bh280")
    with pytest.raises(ValueError, match="read-only"):
        hand.joint_upper[0] = 1.0


def test_an_unknown_hand_is_refused_with_the_known_ones():
    assert "barrett_bh280" in available_hands()
    with pytest.raises(RequestError, match=r"'shadow'.*barrett_bh280"):
        load_hand("shadow")
    with pytest.raises(RequestError, match="Unknown hand"):
        load_hand("../models/barrett_bh280")


def test_robot_description_names_every_mesh_by_an_absolute_uri():
    hand = load_hand()
    text = urdf_text(hand)
    folder = hand.urdf_path.parent
    names = [line.split('"')[1] for line in text.splitlines() if "<mesh" in line]
    assert len(names) > 20
    for name in names:
        assert name.startswith("file:///")
        assert (folder / "meshes" / name.rsplit("/", 1)[1]).is_file()
    assert 'filename="package://a/b/meshes/palm_base.stl"' in urdf_text(hand, "package://a/b/")
