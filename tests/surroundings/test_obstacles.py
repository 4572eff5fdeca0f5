"""Surroundings: what is refused, with its code, and how frames change them."""

from __future__ import annotations

import re

import numpy as np
import pytest
import trimesh

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.transforms import from_position_quat_xyzw
from gpis_grasp_planner.surroundings.obstacles import (
    BoxObstacle,
    MeshObstacle,
    SupportPlane,
    Surroundings,
)

T = from_position_quat_xyzw([0.1, -0.2, 0.3], np.array([1.0, 2.0, 3.0, 4.0]) / np.sqrt(30.0))


def cube():
    solid = trimesh.creation.box((0.1, 0.1, 0.1))
    return TriangleMesh(np.array(solid.vertices), np.array(solid.faces, np.int32))


def test_a_plane_seen_from_the_part_has_the_same_heights():
    rng = np.random.default_rng(0)
    plane = SupportPlane(rng.standard_normal(3), 5.0 * rng.standard_normal(3))
    assert np.linalg.norm(plane.normal) == pytest.approx(1.0)
    seen = Surroundings(plane).seen_from(T).support
    p_object = rng.standard_normal((20, 3))
    p_world = p_object @ T[:3, :3].T + T[:3, 3]
    assert (p_object - seen.point) @ seen.normal == pytest.approx(
        (p_world - plane.point) @ plane.normal, abs=1e-12
    )


def test_a_box_seen_from_the_part_has_its_corners_where_they_were():
    box = BoxObstacle(T, np.array([0.1, 0.2, 0.3]))
    [seen] = Surroundings(None, (box,)).seen_from(T).obstacles
    np.testing.assert_allclose(seen.pose, np.eye(4), atol=1e-12)
    np.testing.assert_array_equal(np.ptp(seen.corners, axis=0), box.size)


def test_a_mesh_keeps_its_tree_when_it_is_moved():
    mesh = MeshObstacle(T, cube())
    [seen] = Surroundings(None, (mesh,)).seen_from(T).obstacles
    assert seen.tree is mesh.tree


def test_the_json_form_is_read():
    loaded = []

    def load(what):
        loaded.append(what)
        return cube()

    around = Surroundings.from_mapping(
        {
            "support": {"point": [0, 0, 0.7], "normal": [0, 0, 2]},
            "obstacles": [
                {"name": "wall", "position": [1, 0, 0], "size": [0.1, 2, 2]},
                {"mesh": "bin.stl", "quat_xyzw": [0, 0, 1, 0]},
            ],
        },
        load,
    )
    assert loaded == ["bin.stl"]
    assert around.support.normal.tolist() == [0.0, 0.0, 1.0]
    wall, mesh = around.obstacles
    assert (wall.name, mesh.name) == ("wall", "obstacle 1")
    np.testing.assert_allclose(np.diag(mesh.pose), [-1.0, -1.0, 1.0, 1.0], atol=1e-12)
    assert not Surroundings.from_mapping({})
    assert around


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"tables": []}, "Unknown name 'tables'"),
        ([], "list"),
        ({"support": {"point": [0, 0]}}, "3 finite numbers"),
        ({"support": {"point": [0, 0, float("nan")]}}, "3 finite numbers"),
        ({"support": {"normal": [0, 0, 0]}}, "length 0"),
        ({"support": {"point": [0, 0, 800.0]}}, "metres"),
        ({"support": {"point": "here"}}, "3 finite numbers"),
        ({"obstacles": 3}, "give a list"),
        ({"obstacles": [4]}, "give an object"),
        ({"obstacles": [{"position": [0, 0, 0]}]}, "'size'"),
        ({"obstacles": [{"size": [1, 1, -1]}]}, "not negative"),
        ({"obstacles": [{"size": [1, 1, 1], "mesh": "a"}]}, "either"),
        ({"obstacles": [{"size": [1, 1, 1], "quat_xyzw": [0, 0, 0, 0]}]}, "norm 0"),
        ({"obstacles": [{"mesh": "a.stl"}]}, "give boxes"),
        ({"obstacles": [{"size": [1, 1, 1]}] * 201}, "at most 200"),
    ],
)
def test_a_bad_description_is_refused_by_name(data, words):
    with pytest.raises(RequestError, match=re.escape(words)) as caught:
        Surroundings.from_mapping(data)
    assert caught.value.code == ErrorCode.INVALID_SCENE


@pytest.mark.parametrize("pose", [np.eye(3), 2.0 * np.eye(4), np.full((4, 4), np.nan)])
def test_a_pose_that_is_no_transform_is_refused(pose):
    with pytest.raises(RequestError, match="rigid transform"):
        BoxObstacle(pose, np.ones(3))


def test_an_empty_mesh_is_refused():
    empty = TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))
    with pytest.raises(RequestError, match="0 faces"):
        MeshObstacle(np.eye(4), empty)
