"""A hand whose URDF has its palm along another axis is the same hand, up to that rotation."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
import yaml
from hand_models import turned_copy
from planning_fixtures import make_part
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.grasp.scene_settings import SceneSettings
from gpis_grasp_planner.hand.description import load_hand, urdf_text
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.palm_turn import palm_turn
from gpis_grasp_planner.hand.urdf import read_urdf, visual_shapes
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import DEFAULT_FRICTION, PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator

AXES = [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (0.3, -0.5, 0.7)]


@pytest.mark.parametrize("axis", AXES)
def test_the_turn_is_a_rotation_that_brings_the_axis_to_z_by_the_least_angle(axis) -> None:
    R, a = palm_turn(axis), np.array(axis) / np.linalg.norm(axis)
    assert pytest.approx(np.eye(3), abs=1e-14) == R @ R.T
    assert np.linalg.det(R) == pytest.approx(1.0)
    assert R @ a == pytest.approx([0.0, 0.0, 1.0], abs=1e-14)
    assert Rotation.from_matrix(R).magnitude() == pytest.approx(np.arccos(a[2]))


@pytest.mark.parametrize("axis", [(0, 0, 0), (1, 0), "z", (np.nan, 0, 1)])
def test_no_axis_is_an_error(axis) -> None:
    with pytest.raises(ValueError, match=r"palm_axis|convert"):
        palm_turn(axis)


@pytest.mark.parametrize("name", ["barrett_bh280", "parallel_jaw", "four_finger_16"])
def test_kinematics_shapes_and_contacts_are_those_of_the_hand(name, rng, tmp_path) -> None:
    Q = Rotation.random(random_state=rng).as_matrix()
    hand, turned = load_hand(name), turned_copy(name, Q, tmp_path / "turned")
    about_z = turned.palm_turn @ Q
    assert about_z[2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
    q = rng.uniform(hand.joint_lower, hand.joint_upper, (5, hand.n_joints))
    T, T_turned = link_transforms(hand, q), link_transforms(turned, q)
    for link in range(1, hand.n_links):
        expected = about_z @ T[:, link, :3, :3]
        assert T_turned[:, link, :3, :3] == pytest.approx(expected, abs=1e-9)
        assert T_turned[:, link, :3, 3] == pytest.approx(T[:, link, :3, 3] @ about_z.T, abs=1e-9)
    for piece, same in zip(turned.link_collision[0], hand.link_collision[0], strict=True):
        assert piece.vertices == pytest.approx(same.vertices @ about_z.T, abs=1e-9)
    of_palm = hand.desired_contacts.links == 0
    for mine, other in (
        (turned.desired_contacts.points, hand.desired_contacts.points),
        (turned.desired_contacts.normals, hand.desired_contacts.normals),
    ):
        assert mine[of_palm] == pytest.approx(other[of_palm] @ about_z.T, abs=1e-9)
        assert mine[~of_palm] == pytest.approx(other[~of_palm], abs=1e-12)
    seen = visual_shapes(turned.urdf_path, turned, turned.palm_turn)[0]
    for piece, same in zip(seen, visual_shapes(hand.urdf_path, hand)[0], strict=True):
        assert piece.vertices == pytest.approx(same.vertices @ about_z.T, abs=1e-9)


def test_the_published_urdf_is_the_turned_hand(rng, tmp_path) -> None:
    """It needs no further turn: read by itself it has the kinematics of the planner's hand."""
    Q = Rotation.random(random_state=rng).as_matrix()
    turned = turned_copy("parallel_jaw", Q, tmp_path / "turned")
    path = turned.urdf_path.parent / "published.urdf"
    path.write_text(urdf_text(turned, ".").replace("./", ""))
    published = read_urdf(path)
    assert published.T_parent_joint == pytest.approx(turned.T_parent_joint, abs=1e-12)
    for piece, same in zip(published.link_collision[0], turned.link_collision[0], strict=True):
        assert piece.vertices == pytest.approx(same.vertices, abs=1e-12)


@pytest.mark.parametrize("name", ["barrett_bh280", "parallel_jaw"])
def test_grasps_are_the_same_up_to_the_rotation(name, rng, tmp_path) -> None:
    Q = Rotation.random(random_state=rng).as_matrix()
    hand, turned = load_hand(name), turned_copy(name, Q, tmp_path / "turned")
    about_z = np.eye(4)
    about_z[:3, :3] = turned.palm_turn @ Q
    part = make_part("block", trimesh.creation.box((0.03, 0.04, 0.07)))
    evaluators = [
        CompiledEvaluator(each, part, DEFAULT_FRICTION, SceneSettings()) for each in (hand, turned)
    ]
    n = 300
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, :3, :3] = Rotation.random(n, random_state=rng).as_matrix()
    T[:, :3, 3] = -T[:, :3, 2] * rng.uniform(0.09, 0.2, (n, 1))
    spread = rng.uniform(0.0, hand.preshape.upper, (n, len(hand.preshape)))
    one = evaluators[0].attempt(T, spread)
    other = evaluators[1].attempt(T @ about_z.T, spread)
    same = one.status == other.status
    assert same.sum() >= 0.95 * n  # rounding may decide what just touches
    held = np.flatnonzero(same & (one.epsilon > 0.0))
    assert len(held) >= 3
    assert other.joints[held] == pytest.approx(one.joints[held], abs=2e-3)
    assert np.median(np.abs(other.epsilon[held] - one.epsilon[held])) < 1e-3
    back = other.T_object_palm[held] @ about_z
    assert back == pytest.approx(one.T_object_palm[held], abs=1e-4)


def test_a_turned_hand_plans_the_grasps_of_the_hand(tmp_path) -> None:
    """Turned by the least rotation both have the same palm frame, and so the same search."""
    Q = palm_turn((1.0, 0.0, 0.0)).T
    turned = turned_copy("barrett_bh280", Q, tmp_path / "turned")
    assert turned.palm_turn @ Q == pytest.approx(np.eye(3), abs=1e-12)
    part = make_part("block", trimesh.creation.box((0.03, 0.04, 0.07)))
    request = PlanRequest(seed=5, max_evaluations=300, time_budget_s=300.0, n_grasps=5)
    plans = [
        GraspPlanner(PlannerSettings.from_mapping({"hand": {"model": model}})).plan(part, request)
        for model in ("barrett_bh280", str(turned.yaml_path))
    ]
    assert len(plans[0].grasps) == 5
    for one, same in zip(plans[0].grasps, plans[1].grasps, strict=True):
        assert same.T_object_palm == pytest.approx(one.T_object_palm, abs=1e-6)
        assert same.joints == pytest.approx(one.joints, abs=1e-5)
        assert same.epsilon == pytest.approx(one.epsilon, abs=1e-5)


def test_a_description_without_length_of_its_axis_is_refused(tmp_path) -> None:
    hand = turned_copy("parallel_jaw", np.eye(3), tmp_path / "own")
    data = yaml.safe_load(hand.yaml_path.read_text()) | {"palm_axis": [0, 0, 0]}
    other = hand.yaml_path.with_name("other.yaml")
    other.write_text(yaml.safe_dump(data))
    with pytest.raises(RequestError, match="palm_axis is"):
        load_hand(str(other))
