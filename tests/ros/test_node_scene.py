"""A node over real DDS with a table, obstacles and uncertain poses; hands are placed again here."""

from __future__ import annotations

import math
import os
import signal
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, PoseWithCovariance, Vector3
from sensor_msgs.msg import JointState

from gpis_grasp_msgs.msg import Grasp, Obstacle, PartPose, PartPoses
from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.hand.description import load_hand

Ask = Callable[..., PlanGrasp.Response]

HAND = load_hand()
TABLE_M = 0.75
MARGIN_M = 0.003
HEADING = (0.0, 0.0, math.sin(0.4), math.cos(0.4))
MUG = MeshCatalogue([default_catalogue_directory()]).load("mug").mesh
ON_TABLE = (0.6, 0.1, TABLE_M - MUG.bounds[0][2])


def turn(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rodrigues' formula, (4, 4)."""
    x, y, z = axis / np.linalg.norm(axis)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    T = np.eye(4)
    T[:3, :3] += np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
    return T


def hand_points(T_world_palm: np.ndarray, state: JointState) -> np.ndarray:
    """All corners (n, 3) of the hand's pieces in the world; the chain is walked joint by joint."""
    angle = dict(zip(state.name, state.position, strict=True))
    T: list[np.ndarray] = []
    points = []
    for link, parent in enumerate(HAND.link_parent):
        here = T_world_palm if parent < 0 else T[parent] @ HAND.T_parent_joint[link]
        joint = HAND.link_joint[link]
        if joint >= 0:
            here = here @ turn(HAND.joint_axis[link], angle[HAND.joint_names[joint]])
        T.append(here)
        points += [p.vertices @ here[:3, :3].T + here[:3, 3] for p in HAND.link_collision[link]]
    return np.concatenate(points)


def way(grasp: Grasp, tools: Any) -> list[np.ndarray]:
    """Corners of the hand where the approach begins, before it closes, and closed."""
    palm, back = (tools.matrix(p.pose) for p in (grasp.palm_pose, grasp.pre_grasp_palm_pose))
    return [
        hand_points(back, grasp.pre_grasp),
        hand_points(palm, grasp.pre_grasp),
        hand_points(palm, grasp.grasp),
    ]


def box(tools: Any, xyz: Any, size: Any, frame: str = "world", **fields: Any) -> Obstacle:
    sides = Vector3(**dict(zip("xyz", map(float, size), strict=True)))
    return Obstacle(pose=tools.pose(frame, xyz), size=sides, **fields)


@pytest.fixture(scope="module")
def ask(client: Any) -> Ask:
    """Call with a budget that leaves a slow machine some grasps to choose from."""
    return partial(client.plan, time_budget=6.0)


@pytest.fixture(scope="module")
def planned(node: Any, ask: Ask) -> PlanGrasp.Response:
    """The plan in free space that all answers here are chosen from."""
    response = ask("mug")
    assert response.success, response.message
    return response


@pytest.fixture
def standing(tools: Any) -> dict[str, Any]:
    """Request fields of a mug that stands on a table."""
    return {
        "object_pose": tools.pose("world", ON_TABLE, HEADING),
        "support_plane": tools.pose("world", (0.0, 0.0, TABLE_M)),
    }


def test_no_grasp_of_a_mug_on_a_table_comes_through_the_table(
    ask: Ask, planned: PlanGrasp.Response, tools: Any, standing: dict[str, Any]
) -> None:
    first = ask("mug", **standing)  # a plan in free space is none for a table
    assert first.success, first.message
    assert not first.from_cache
    response = ask("mug", **standing)
    assert response.success, response.message
    assert response.from_cache
    for grasp in (*first.grasps, *response.grasps):
        for points in way(grasp, tools):
            assert points[:, 2].min() >= TABLE_M + MARGIN_M - 1e-6
        lift = grasp.lift_direction
        assert lift.header == grasp.palm_pose.header
        assert (lift.vector.x, lift.vector.y, lift.vector.z) == pytest.approx((0, 0, 1), abs=1e-9)
    # the test can fail: a grasp of the plan in free space does come through
    low = min(points[:, 2].min() for grasp in planned.grasps for points in way(grasp, tools))
    assert low < MUG.bounds[0][2]


def test_without_a_support_the_lift_goes_back_along_the_approach(
    planned: PlanGrasp.Response,
) -> None:
    for grasp in planned.grasps:
        a, b = grasp.approach_direction.vector, grasp.lift_direction.vector
        assert (b.x, b.y, b.z) == pytest.approx((-a.x, -a.y, -a.z), abs=1e-12)
        assert grasp.hold_probability == -1.0


def test_a_tilted_plane_is_taken_with_its_own_z_axis(
    ask: Ask, planned: PlanGrasp.Response, tools: Any
) -> None:
    half = math.sqrt(0.5)
    wall = tools.pose("world", (0.5 + MUG.bounds[0][0] - 0.01, 0.0, 0.0), (0.0, half, 0.0, half))
    response = ask("mug", support_plane=wall)  # z of the plane along x of the world
    assert response.success, response.message
    for grasp in response.grasps:
        nearest = min(points[:, 0].min() for points in way(grasp, tools))
        assert nearest >= wall.pose.position.x + MARGIN_M - 1e-6
        assert grasp.lift_direction.vector.x == pytest.approx(1.0, abs=1e-9)


def test_an_obstacle_in_the_place_of_the_palm_is_kept_clear_of(
    ask: Ask, planned: PlanGrasp.Response, tools: Any
) -> None:
    best = tools.matrix(planned.grasps[0].palm_pose.pose)
    centre = best[:3, 3] + 0.04 * best[:3, 2]  # in the palm of the best grasp
    response = ask("mug", obstacles=[box(tools, centre, (0.05, 0.05, 0.05), name="lamp")])
    assert response.success, response.message
    for grasp in response.grasps:
        assert not np.allclose(tools.matrix(grasp.palm_pose.pose), best, atol=1e-6)
        for points in way(grasp, tools):
            assert not (np.abs(points - centre) < 0.025).all(axis=1).any()


def test_a_mesh_of_the_catalogue_is_an_obstacle_too(
    ask: Ask, planned: PlanGrasp.Response, tools: Any
) -> None:
    """A ball just behind the mug: no hand reaches through it, and the nearest wall is kept."""
    ball = Obstacle(name="ball", mesh_id="sphere", pose=tools.pose("world", (0.5, 0.12, 0.0)))
    response = ask("mug", obstacles=[ball])
    assert response.success, response.message
    mesh = MeshCatalogue([default_catalogue_directory()]).load("sphere").mesh
    radius = np.linalg.norm(mesh.vertices, axis=1).min()
    for grasp in response.grasps:
        for points in way(grasp, tools):
            assert np.linalg.norm(points - [0.5, 0.12, 0.0], axis=1).min() > radius


def test_inside_rock_everything_is_blocked_and_another_search_finds_nothing(
    ask: Ask, planned: PlanGrasp.Response, tools: Any
) -> None:
    rock = box(tools, (0.5, 0.0, 0.0), (2.0, 2.0, 2.0), name="rock")
    response = ask("mug", obstacles=[rock])
    assert response.code == ErrorCode.ALL_GRASPS_BLOCKED
    assert not response.success
    assert response.grasps == []
    assert "blocked" in response.message
    assert "attempts" in response.message
    assert not response.from_cache
    assert ask("mug").from_cache


BAD = {
    "another frame of the support": ({"support": ("table", {})}, ["'table'", "'world'"]),
    "another frame of an obstacle": ({"box": {"frame": "cell"}}, ["'cell'", "'world'", "lamp"]),
    "no frame of an obstacle": ({"box": {"frame": ""}}, ["lamp", "'world'"]),
    "a support without a frame": ({"support": ("", {"xyz": (0, 0, 1)})}, ["header.frame_id"]),
    "a support that is not finite": (
        {"support": ("world", {"xyz": (0, 0, math.nan)})},
        ["support_plane", "nan"],
    ),
    "a support without a direction": (
        {"support": ("world", {"xyzw": (0, 0, 0, 0)})},
        ["support_plane", "norm 0"],
    ),
    "no size": ({"box": {"size": (0, 0, 0)}}, ["lamp", "size"]),
    "a negative size": ({"box": {"size": (1, -1, 1)}}, ["lamp", "-1"]),
    "size and mesh": ({"box": {"mesh_id": "sphere"}}, ["lamp", "either"]),
    "an unknown mesh": ({"box": {"size": (0, 0, 0), "mesh_id": "sphre"}}, ["sphre", "sphere"]),
    "an implausible place": ({"box": {"xyz": (1e4, 0, 0)}}, ["lamp", "100 m"]),
    "too many": ({"box": {}, "times": 201}, ["201", "200"]),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_scene_is_refused_at_once(
    ask: Ask, planned: PlanGrasp.Response, tools: Any, name: str
) -> None:
    given, words = BAD[name]
    fields: dict[str, Any] = {}
    if "support" in given:
        frame, pose = given["support"]
        fields["support_plane"] = tools.pose(frame, **{"xyz": (0, 0, 0), **pose})
    if "box" in given:
        values = {"xyz": (1, 1, 1), "size": (1, 1, 1), "name": "lamp", **given["box"]}
        fields["obstacles"] = [box(tools, **values)] * given.get("times", 1)
    response = ask("sphere", seed=99, **fields)  # nobody has planned this
    code = "NO_TRANSFORM" if name.startswith("another frame") else "INVALID_SCENE"
    assert ErrorCode(response.code).name == code, response.message
    assert response.evaluations == 0
    for word in words:
        assert word in response.message


def test_an_uncertain_pose_gives_hold_probabilities_in_order(
    client: Any, ask: Ask, planned: PlanGrasp.Response, tools: Any
) -> None:
    """Of an exactly known mug a grasp holds or it does not; 5 mm and 5 degrees tell more apart."""
    publisher = client.node.create_publisher(PartPoses, "part_poses", 1)

    def answer(frame: str, covariance: np.ndarray, **fields: Any) -> PlanGrasp.Response:
        last: list[PlanGrasp.Response] = []

        def heard() -> bool:
            message = tools.stamped(client, 0.0, frame=frame)
            pose = PoseWithCovariance(pose=message.pose, covariance=covariance.ravel())
            part = PartPose(header=message.header, mesh_id="mug", pose=pose)
            publisher.publish(PartPoses(parts=[part]))
            last[:] = [ask("mug", object_pose=PoseStamped(), **fields)]
            frames = {g.palm_pose.header.frame_id for g in last[0].grasps}
            # Without an estimate, or by an earlier one in a frame that the table is not in.
            too_early = last[0].code in (last[0].NO_POSE_ESTIMATE, last[0].NO_TRANSFORM)
            return frames == {frame} or not (frames or too_early)

        tools.wait(heard, f"an answer in {frame}", 60.0)
        return last[0]

    sure = np.diag([1e-14] * 6)
    response = answer("fixture", sure)
    assert response.success, response.message
    assert {g.hold_probability for g in response.grasps} <= {0.0, 1.0}
    assert all(g.hold_probability == 1.0 for g in response.grasps if g.epsilon > 0.02)
    assert response.grasps[0].hold_probability == 1.0

    noise = np.diag([0.005**2] * 3 + [math.radians(5.0) ** 2] * 3)
    response = answer("camera", noise)
    held = [g.hold_probability for g in response.grasps]
    assert all(0.0 <= p <= 1.0 for p in held)
    assert held == sorted(held, reverse=True)
    assert len(held) == len(planned.grasps)
    first = answer("camera", noise, n_grasps=1)  # of all candidates, not of the first by epsilon
    assert [g.hold_probability for g in first.grasps] == held[:1]

    table = tools.pose("shelf", (0.0, 0.0, MUG.bounds[0][2]))
    response = answer("shelf", noise, support_plane=table)
    assert response.success, response.message
    held = [g.hold_probability for g in response.grasps if g.hold_probability >= 0.0]
    assert held  # as many as the time allowed
    assert held == sorted(held, reverse=True)
    assert all(0.0 <= p <= 1.0 for p in held)
    for grasp in response.grasps:
        assert min(p[:, 2].min() for p in way(grasp, tools)) >= MUG.bounds[0][2] + MARGIN_M - 1e-6

    negative = np.diag([1e-6, 1e-6, -1e-4, 0.0, 0.0, 0.0])

    def refused() -> bool:
        message = tools.stamped(client, 0.0, frame="camera")
        pose = PoseWithCovariance(pose=message.pose, covariance=negative.ravel())
        publisher.publish(
            PartPoses(parts=[PartPose(header=message.header, mesh_id="mug", pose=pose)])
        )
        response = ask("mug", object_pose=PoseStamped())
        return response.code == ErrorCode.INVALID_COVARIANCE and "-0.0001" in response.message

    tools.wait(refused, "INVALID_COVARIANCE")
    client.in_executor(client.node.destroy_publisher, publisher)


def test_a_kept_plan_is_placed_while_another_is_made(
    client: Any, ask: Ask, planned: PlanGrasp.Response, tools: Any, standing: dict[str, Any]
) -> None:
    assert ask("mug", **standing).success
    running = client.call_async(tools.request("sphere", time_budget=8.0, seed=41))
    response = ask("mug", **standing)
    assert response.success, response.message
    assert response.from_cache
    assert not running.done()
    tools.wait(running.done, "the plan", 120.0)
    assert running.result().success


def test_a_kept_plan_is_placed_by_a_new_planning_process(
    node: Any, ask: Ask, planned: PlanGrasp.Response, standing: dict[str, Any]
) -> None:
    before = ask("mug", **standing)
    worker = node.wait_worker()
    os.kill(worker, signal.SIGKILL)
    response = ask("mug", **standing)
    assert response.success, response.message
    assert response.from_cache
    assert node.wait_worker() != worker
    assert response.grasps[0].palm_pose.pose in [g.palm_pose.pose for g in before.grasps]
