"""Hand and object as arrays: what the compiled loops rely on."""

import shutil

import numba
import numpy as np
import pytest
import trimesh

from gpis_grasp_planner import compiled_cache
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.surface_points import surface_points
from gpis_grasp_planner.scene import arrays as module
from gpis_grasp_planner.scene.arrays import hand_arrays, kept_surface_points, object_arrays


@pytest.fixture(scope="module")
def arrays():
    return hand_arrays(load_hand())


def surface_of_union(pieces, rng):
    """Random points on a link's surface that no other piece covers."""
    points = []
    for index, piece in enumerate(pieces):
        shape = trimesh.Trimesh(piece.vertices, piece.faces, process=False)
        p, _ = trimesh.sample.sample_surface(shape, 4000, seed=int(rng.integers(2**31)))
        for other_index, other in enumerate(pieces):
            if other_index != index:
                n = other.face_normals_outward
                offset = np.einsum("ij,ij->i", n, other.triangles[:, 0])
                p = p[(p @ n.T - offset).max(axis=1) > 0.0]
        points.append(p)
    return np.concatenate(points)


def test_no_place_of_a_link_is_farther_from_its_probes_than_its_cover(arrays, rng):
    for link, pieces in enumerate(load_hand().link_collision):
        places = surface_of_union(pieces, rng)
        distance = np.linalg.norm(places[:, None] - arrays.probes[link][None], axis=2).min(axis=1)
        assert distance.max() <= arrays.link_cover[link]
        assert distance.max() > 0.7 * arrays.link_cover[link]  # nor is the bound a loose one


def test_no_place_of_a_link_is_faster_than_its_radius(arrays, rng):
    hand = load_hand()
    for index, finger in enumerate(hand.fingers):
        for k, link in enumerate(finger.links):
            assert arrays.link_finger[link] == index
            places = surface_of_union(hand.link_collision[link], rng)
            radius = np.linalg.norm(np.cross(hand.joint_axis[link], places), axis=1)
            assert radius.max() <= arrays.link_reach[link, k]
        # about the inner axis, with the distal joint anywhere: two radii at most
        offset = np.linalg.norm(hand.T_parent_joint[finger.distal_link][:3, 3])
        reach = offset + np.linalg.norm(places, axis=1).max()
        assert reach <= arrays.link_reach[finger.distal_link, 0]


def test_pieces_and_points_are_those_of_their_links(arrays):
    hand = load_hand()
    piece = 0
    for link, pieces in enumerate(hand.link_collision):
        assert arrays.link_piece_start[link] == piece
        for mesh in pieces:
            rows = slice(arrays.piece_start[piece], arrays.piece_start[piece + 1])
            np.testing.assert_array_equal(arrays.piece_vertices[rows], mesh.vertices)
            np.testing.assert_array_equal(arrays.piece_lower[piece], mesh.vertices.min(axis=0))
            np.testing.assert_array_equal(arrays.piece_upper[piece], mesh.vertices.max(axis=0))
            assert arrays.piece_link[piece] == link
            piece += 1
    assert arrays.link_piece_start[-1] == piece
    assert arrays.point_start[-1] == len(arrays.points) == len(arrays.point_normals)
    assert set(arrays.open_links) | set(np.flatnonzero(arrays.link_finger >= 0)) == set(
        range(hand.n_links)
    )


def test_parents_come_before_their_children(arrays):
    for link, parent in enumerate(arrays.parent):
        assert parent < link


def test_object_carries_the_requests_friction_and_the_parts_scale(scene):
    s = scene("box")
    obj = object_arrays(s.part, Friction(0.7, 0.2), s.evaluator.field, s.evaluator.tree)
    assert (obj.friction_finger, obj.friction_palm) == (0.7, 0.2)
    assert obj.torque_scale == pytest.approx(0.5 * np.linalg.norm([0.05, 0.06, 0.08]))
    np.testing.assert_allclose(obj.center_of_mass, 0.0, atol=1e-12)


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """Return the only folder of what is kept beside the compiled code."""
    monkeypatch.setattr(compiled_cache, "folders", lambda: (tmp_path,))
    hand_arrays.cache_clear()
    yield tmp_path
    hand_arrays.cache_clear()


def assert_same(one, other):
    for name, a, b in zip(one._fields, one, other, strict=True):
        np.testing.assert_array_equal(a, b, err_msg=name)
        assert numba.typeof(a) == numba.typeof(b), name


def test_a_hands_arrays_are_made_once_and_read_afterwards(kept, monkeypatch):
    made = hand_arrays(load_hand())
    assert hand_arrays(load_hand()) is made
    hand_arrays.cache_clear()
    monkeypatch.setattr(module, "surface_points", None)
    assert_same(hand_arrays(load_hand()), made)


def test_a_damaged_file_of_a_hand_is_made_anew(kept):
    made = hand_arrays(load_hand())
    [path] = kept.iterdir()
    content = path.read_bytes()
    path.write_bytes(content[:-8])
    hand_arrays.cache_clear()
    assert_same(hand_arrays(load_hand()), made)
    assert path.read_bytes() == content


def test_a_change_of_the_hands_files_or_the_code_is_another_file(
    kept, monkeypatch, tmp_path_factory
):
    before = module.hand_key(load_hand(), "scene/arrays.py")
    models = tmp_path_factory.mktemp("models") / "hand"
    shutil.copytree(load_hand().urdf_path.parent, models)
    [own] = models.glob("*.yaml")
    copy = load_hand(str(own))
    assert module.hand_key(copy, "scene/arrays.py") == before
    with own.open("a") as file:
        file.write("# edited\n")
    # The hand that was read keeps its key; the file's hand is another one.
    assert module.hand_key(copy, "scene/arrays.py") == before
    load_hand.cache_clear()
    assert module.hand_key(load_hand(str(own)), "scene/arrays.py") != before
    monkeypatch.setattr(module, "code_version", lambda *_: "later")
    assert module.hand_key(load_hand(), "scene/arrays.py") != before


def test_kept_surface_points_are_those_of_the_hand():
    hand = load_hand()
    kept, made = kept_surface_points(hand), surface_points(hand)
    for name in ("points", "normals_outward", "links", "offsets"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(made, name))
