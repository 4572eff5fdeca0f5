"""Scenes from requests and parameters, without a node."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, Vector3

from gpis_grasp_msgs.msg import Obstacle
from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.errors import ErrorCode, PoseError, RequestError
from gpis_grasp_planner.geometry.transforms import from_position_quat_xyzw, inverse
from gpis_grasp_planner.ros.request_guard import ObjectPose
from gpis_grasp_planner.ros.scene_source import SceneSource
from gpis_grasp_planner.ros.settings import NodeSettings

HALF = math.sqrt(0.5)
POSE = ObjectPose(
    from_position_quat_xyzw([0.5, 0.0, 0.8], [0.0, 0.0, HALF, HALF]), "cell", 1, None, ()
)
WALL = "[{name: wall, position: [0.4, 0, 0.9], size: [0.02, 1, 0.3]}]"


def no_mesh(mesh_id: str) -> None:
    raise RequestError(f"'{mesh_id}' is unknown", ErrorCode.UNKNOWN_MESH)


def source(check: Callable[[str], None] = no_mesh, **settings: Any) -> SceneSource:
    return SceneSource(lambda: NodeSettings(**settings), check)


def plane(frame: str, z: float) -> PoseStamped:
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.z = z
    return message


def test_nothing_by_default() -> None:
    assert not source().place(PlanGrasp.Request(), POSE)


def test_the_default_support_stands_where_no_request_gives_one() -> None:
    scenes = source(support_frame="cell", support_pose=f"0 0 0.75 0 {HALF} 0 {HALF}")
    support = scenes.place(PlanGrasp.Request(), POSE).surroundings.support
    assert support is not None
    assert support.point == pytest.approx([0, 0, 0.75])
    assert support.normal == pytest.approx([1, 0, 0])  # z of a plane turned about y by 90 degrees
    given = scenes.place(PlanGrasp.Request(support_plane=plane("cell", 0.3)), POSE)
    assert given.surroundings.support is not None
    assert given.surroundings.support.point == pytest.approx([0, 0, 0.3])
    assert given.surroundings.support.normal == pytest.approx([0, 0, 1])


def test_a_support_without_a_frame_is_refused_and_not_replaced_by_the_default_one() -> None:
    scenes = source(support_frame="cell", support_pose="0 0 0.75 0 0 0 1")
    with pytest.raises(RequestError, match="a pose and no frame") as caught:
        scenes.place(PlanGrasp.Request(support_plane=plane("", 0.3)), POSE)
    assert caught.value.code == ErrorCode.INVALID_SCENE


def test_obstacles_of_the_request_come_beside_the_default_ones() -> None:
    box = Obstacle(pose=plane("cell", 1.0), size=Vector3(x=0.1, y=0.2, z=0.3))
    scenes = source(obstacles=WALL, obstacles_frame="cell")
    place = scenes.place(PlanGrasp.Request(obstacles=[box]), POSE)
    assert [o.name for o in place.surroundings.obstacles] == ["wall", "obstacle 0"]
    seen = place.around().obstacles[1]  # the part is turned by 90 degrees about z
    assert seen.pose[:3, 3] == pytest.approx([0.0, 0.5, 0.2])


@pytest.mark.parametrize(
    ("settings", "parameter"),
    [
        ({"support_frame": "world"}, "support_frame"),
        ({"obstacles": WALL, "obstacles_frame": "world"}, "obstacles_frame"),
    ],
)
def test_defaults_in_another_frame_are_told_and_not_left_out(
    settings: dict[str, Any], parameter: str
) -> None:
    with pytest.raises(PoseError, match=f"{parameter}: .*'world' to 'cell'") as caught:
        source(**settings).place(PlanGrasp.Request(), POSE)
    assert caught.value.code == ErrorCode.NO_TRANSFORM


def test_a_mesh_that_is_not_in_the_catalogue_is_a_bad_scene() -> None:
    ball = Obstacle(pose=plane("cell", 1.0), mesh_id="ball")
    with pytest.raises(RequestError, match="'ball' is unknown") as caught:
        source().place(PlanGrasp.Request(obstacles=[ball]), POSE)
    assert caught.value.code == ErrorCode.INVALID_SCENE
    place = source(lambda _: None).place(PlanGrasp.Request(obstacles=[ball]), POSE)
    assert place.as_mapping()["obstacles"][0]["mesh"] == "ball"


def test_a_name_cannot_forge_a_line_of_the_log() -> None:
    box = Obstacle(name="a\nb", pose=plane("table", 1.0), size=Vector3(x=1.0, y=1.0, z=1.0))
    with pytest.raises(PoseError, match=r"'a\\nb'"):
        source().place(PlanGrasp.Request(obstacles=[box]), POSE)


def test_the_covariance_is_turned_to_the_parts_axes_or_left_alone() -> None:
    C = np.diag([1.0, 4.0, 9.0, 0.1, 0.2, 0.3])
    pose = ObjectPose(POSE.T_world_object, "cell", 1, C, ())
    place = source().place(PlanGrasp.Request(), pose)
    # x of the part is y of the cell
    assert place.covariance is not None
    assert np.diag(place.covariance) == pytest.approx([4.0, 1.0, 9.0, 0.2, 0.1, 0.3])
    off = SceneSource(NodeSettings, no_mesh, lambda: False)
    assert not off.place(PlanGrasp.Request(), pose)


def test_other_frames_are_brought_into_that_of_the_pose_at_its_time() -> None:
    asked: list[tuple[str, str, int]] = []

    def transform(target: str, source: str, stamp_ns: int) -> np.ndarray:
        asked.append((target, source, stamp_ns))
        return from_position_quat_xyzw([0, 0, 1], [HALF, 0, 0, HALF])  # z becomes -y

    scenes = SceneSource(NodeSettings, no_mesh, transform=transform)
    box = Obstacle(name="box", pose=plane("table", 0.5), size=Vector3(x=0.1, y=0.1, z=0.1))
    request = PlanGrasp.Request(support_plane=plane("base", 0.25), obstacles=[box])
    around = scenes.place(request, POSE).surroundings
    assert asked == [("cell", "base", 1), ("cell", "table", 1)]
    assert around.support is not None
    np.testing.assert_allclose(around.support.point, [0, -0.25, 1], atol=1e-12)
    np.testing.assert_allclose(around.support.normal, [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(around.obstacles[0].pose[:3, 3], [0, -0.5, 1], atol=1e-12)


def test_a_part_far_from_its_frames_origin_has_the_same_surroundings() -> None:
    """In a map, say; the planner itself takes nothing beyond 100 m."""
    offset = np.array([350.0, -2100.0, 0.0])

    def around(shift: np.ndarray, **settings: Any) -> Any:
        T = POSE.T_world_object.copy()
        T[:3, 3] += shift
        pose = ObjectPose(T, "cell", 1, None, ())
        x, y, _ = map(float, shift)
        box = Obstacle(name="box", pose=plane("cell", 0.9), size=Vector3(x=0.1, y=0.1, z=0.1))
        box.pose.pose.position.x, box.pose.pose.position.y = x + 0.4, y
        request = PlanGrasp.Request(support_plane=plane("cell", 0.75), obstacles=[box])
        return source(**settings).place(request, pose).around()

    far = f"[{{name: wall, position: [{350.4}, -2100, 0.9], size: [0.02, 1, 0.3]}}]"
    here = around(np.zeros(3), obstacles=WALL, obstacles_frame="cell")
    there = around(offset, obstacles=far, obstacles_frame="cell")
    assert len(here.obstacles) == len(there.obstacles) == 2
    assert here.support.point @ here.support.normal == pytest.approx(
        there.support.point @ there.support.normal, abs=1e-9
    )
    for one, other in zip(here.obstacles, there.obstacles, strict=True):
        np.testing.assert_allclose(one.pose, other.pose, atol=1e-9)


def test_default_obstacles_at_the_other_end_of_the_hall_are_left_out() -> None:
    listed = "[{name: far, position: [3000, 0, 0], size: [1, 1, 1]}]"
    assert not source(obstacles=listed, obstacles_frame="cell").place(PlanGrasp.Request(), POSE)


def test_an_arm_stands_in_its_frame() -> None:
    def transform(target: str, source: str, _: int) -> np.ndarray:
        assert (target, source) == ("cell", "arm_base")
        return from_position_quat_xyzw([0, 0, 1], [HALF, 0, 0, HALF])

    scenes = SceneSource(
        lambda: NodeSettings(arm_frame="arm_base"),
        no_mesh,
        transform=transform,
        arm_model=lambda: "six_axis",
    )
    for far in (0.0, 1000.0):
        moved = replace(POSE, T_world_object=POSE.T_world_object.copy())
        moved.T_world_object[0, 3] += far
        place = scenes.place(PlanGrasp.Request(), moved)
        assert place
        assert place.T_world_arm is not None
        T_arm_object = inverse(place.T_world_arm) @ place.T_world_object
        expected = inverse(transform("cell", "arm_base", 0)) @ moved.T_world_object
        np.testing.assert_allclose(T_arm_object, expected, atol=1e-9)


def test_an_arm_without_a_frame_is_refused() -> None:
    scenes = SceneSource(NodeSettings, no_mesh, arm_model=lambda: "six_axis")
    with pytest.raises(RequestError, match="arm_frame is empty"):
        scenes.place(PlanGrasp.Request(), POSE)


def test_the_flange_is_the_arms(tmp_path: Path) -> None:
    file = tmp_path / "arm.yaml"
    file.write_text("arm: six_axis\nflange: {position: [0.0, 0.0, 0.05]}\n")
    arm = SceneSource(NodeSettings, no_mesh, arm_model=lambda: str(file)).palm_flange()
    assert arm is not None
    np.testing.assert_allclose(arm[:3, 3], [0.0, 0.0, -0.05])
    same = NodeSettings(palm_flange_pose="0 0 -0.05 0 0 0 1")
    other = NodeSettings(palm_flange_pose="0 0 -0.06 0 0 0 1")
    assert SceneSource(lambda: same, no_mesh, arm_model=lambda: str(file)).palm_flange() is not None
    with pytest.raises(RequestError, match="another flange"):
        SceneSource(lambda: other, no_mesh, arm_model=lambda: str(file)).palm_flange()
    assert SceneSource(NodeSettings, no_mesh).palm_flange() is None
