"""Support, points and obstacles as texts of parameters: known values, and what is refused."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError
from gpis_grasp_planner.ros.scene_defaults import (
    FARTHEST_M,
    near_origin,
    obstacles_of,
    point_of_text,
    pose_of_text,
    read_far_position,
)


def rotated(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """V turned by the unit quaternion (x, y, z, w): v + 2 u x (u x v + w v)."""
    u, w = q[:3], q[3]
    return v + 2.0 * np.cross(u, np.cross(u, v) + w * v)


def test_a_pose_is_position_and_rotation_of_its_seven_numbers(rng: np.random.Generator) -> None:
    for _ in range(50):
        q, p = rng.normal(size=4), rng.uniform(-10.0, 10.0, 3)
        q /= np.linalg.norm(q)
        T = pose_of_text(" ".join(map(repr, map(float, [*p, *q]))), "support_pose")
        v = rng.normal(size=3)
        assert np.allclose(T @ [*v, 1.0], [*(rotated(q, v) + p), 1.0], atol=1e-12)


def test_a_quarter_turn_about_z_takes_x_to_y() -> None:
    T = pose_of_text("1 2 3 0 0 0.7071067811865476 0.7071067811865476", "support_pose")
    assert np.allclose(T, [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])


def test_a_pose_is_shared_and_so_cannot_be_written_to() -> None:
    T = pose_of_text("0 0 0.75 0 0 0 1", "support_pose")
    assert pose_of_text("0 0 0.75 0 0 0 1", "support_pose") is T
    with pytest.raises(ValueError, match="read-only"):
        T[0, 3] = 1.0


def test_a_support_may_be_as_far_as_a_map_reaches() -> None:
    assert pose_of_text(f"{FARTHEST_M} 0 0 0 0 0 1", "support_pose")[0, 3] == FARTHEST_M


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "seven numbers"),
        ("0 0 0 0 0 0", "seven numbers"),
        ("0 0 0 0 0 0 1 0", "seven numbers"),
        ("0,0,0,0,0,0,1", "seven numbers"),
        ("a 0 0 0 0 0 1", "seven numbers"),
        ("nan 0 0 0 0 0 1", "finite"),
        ("0 inf 0 0 0 0 1", "finite"),
        ("0 0 1.1e6 0 0 0 1", "limit is 1e+06 m"),
        ("0 0 0 0 0 0 0", "support_pose"),
        ("0 0 0 nan 0 0 1", "support_pose"),
    ],
)
def test_what_is_no_pose_is_refused_with_the_name_of_the_setting(text: str, says: str) -> None:
    with pytest.raises(GraspPlannerError) as caught:
        pose_of_text(text, "support_pose")
    assert caught.value.code is ErrorCode.INVALID_SCENE
    assert says in caught.value.message
    assert "support_pose" in caught.value.message


def test_a_point_is_its_three_numbers() -> None:
    assert point_of_text("0.5 -1e-3 +2", "instance_point") == (0.5, -0.001, 2.0)


@pytest.mark.parametrize("text", ["", "1 2", "1 2 3 4", "x 2 3", "nan 0 0", "0 0 inf"])
def test_what_is_no_point_is_refused(text: str) -> None:
    with pytest.raises(GraspPlannerError, match="'instance_point'") as caught:
        point_of_text(text, "instance_point")
    assert caught.value.code is ErrorCode.INVALID_SETTING


@pytest.mark.parametrize("value", [None, "here", [1, 2], [[0, 0, 0]], [0, 0, np.nan], {"x": 1}])
def test_what_is_no_position_is_refused(value: Any) -> None:
    with pytest.raises(GraspPlannerError, match="position of the wall") as caught:
        read_far_position(value, "the wall")
    assert caught.value.code is ErrorCode.INVALID_SCENE


@pytest.mark.parametrize(("x", "allowed"), [(-FARTHEST_M, True), (-1.0001 * FARTHEST_M, False)])
def test_the_limit_holds_in_every_direction(x: float, allowed: bool) -> None:
    for k in range(3):
        position = [0.0, 0.0, 0.0]
        position[k] = x
        if allowed:
            assert read_far_position(position, "it").tolist() == position
        else:
            with pytest.raises(GraspPlannerError, match="Give metres"):
                read_far_position(position, "it")


def test_an_obstacle_is_counted_from_the_origin_and_the_given_one_stays() -> None:
    entry = {"name": "wall", "position": [100.5, 2.0, 3.0], "size": [1, 1, 1]}
    near = near_origin(entry, np.array([100.0, 2.0, 1.0]))
    assert near == {"name": "wall", "position": [0.5, 0.0, 2.0], "size": [1, 1, 1]}
    assert entry["position"] == [100.5, 2.0, 3.0]
    assert near_origin(entry)["position"] == [0.0, 0.0, 0.0]
    assert near_origin({"name": "without"}, np.ones(3))["position"] == [-1.0, -1.0, -1.0]


def test_what_is_no_mapping_is_left_to_whoever_reads_obstacles() -> None:
    assert near_origin("a wall", np.ones(3)) == "a wall"


def test_an_obstacle_far_away_is_refused_by_its_name() -> None:
    with pytest.raises(GraspPlannerError, match="'wall'"):
        near_origin({"name": "wall", "position": [2e6, 0, 0]}, np.zeros(3))


@pytest.mark.parametrize("text", ["", "[]", "  "])
def test_no_obstacles_is_an_empty_list(text: str) -> None:
    assert obstacles_of(text) == []


def test_yaml_and_json_say_the_same() -> None:
    wall = {"name": "wall", "position": [0.4, 0, 0.9], "size": [0.02, 1, 0.3]}
    yaml = "[{name: wall, position: [0.4, 0, 0.9], size: [0.02, 1, 0.3]}]"
    assert obstacles_of(yaml) == obstacles_of(json.dumps([wall])) == [wall]


@pytest.mark.parametrize("text", ["{name: wall}", "wall", "3", "[{", "!!python/object:os.system x"])
def test_what_is_no_list_is_refused(text: str) -> None:
    with pytest.raises(GraspPlannerError, match="obstacles") as caught:
        obstacles_of(text)
    assert caught.value.code is ErrorCode.INVALID_SCENE
