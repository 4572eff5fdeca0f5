"""Whole plans before an arm: answers that it reaches, at this pose and no other."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arm_tables import dh_flange

from gpis_grasp_planner.arm.settings import ArmSettings
from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.plan.document import read_document, write_document
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.surroundings.obstacles import SupportPlane, Surroundings
from gpis_grasp_planner.surroundings.place import Place

REQUEST = PlanRequest(max_evaluations=150, time_budget_s=30.0, n_grasps=3)


@pytest.fixture(scope="module")
def mug() -> Part:
    return MeshCatalogue([default_catalogue_directory()]).load("mug")


@pytest.fixture(scope="module")
def planner() -> GraspPlanner:
    return GraspPlanner(PlannerSettings(arm=ArmSettings(model="six_axis")))


def place_at(mug: Part, x: float) -> Place:
    T = np.eye(4)
    T[:3, 3] = x, 0.1, -mug.mesh.bounds[0][2]
    table = SupportPlane(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    return Place(T, Surroundings(table))


def test_answers_carry_the_arms_joints(planner: GraspPlanner, mug: Part, tmp_path: Path) -> None:
    place = place_at(mug, 0.55)
    result = planner.answer(mug, REQUEST, place).result
    assert result.code == ErrorCode.SUCCESS
    for grasp in result.grasps:
        assert grasp.arm is not None
        palm = place.T_world_object @ grasp.T_object_palm
        np.testing.assert_allclose(dh_flange("six_axis", grasp.arm.grasp), palm, atol=1e-8)
        back, up = palm.copy(), palm.copy()
        back[:3, 3] -= grasp.approach_distance * palm[:3, 2]
        up[2, 3] += planner.settings.arm.lift_m
        np.testing.assert_allclose(dh_flange("six_axis", grasp.arm.pregrasp), back, atol=1e-8)
        np.testing.assert_allclose(dh_flange("six_axis", grasp.arm.lifted), up, atol=1e-8)
    # the same from the document
    file = tmp_path / "grasps.json"
    write_document(file, result)
    for read, grasp in zip(read_document(file).result.grasps, result.grasps, strict=True):
        assert read.arm is not None
        assert grasp.arm is not None
        np.testing.assert_array_equal(read.arm.approach, grasp.arm.approach)
        np.testing.assert_array_equal(read.arm.lift, grasp.arm.lift)
        assert read.arm.manipulability == grasp.arm.manipulability
        assert read.arm.joint_names == grasp.arm.joint_names


def test_out_of_reach_nothing_is_answered_and_nothing_closed(
    planner: GraspPlanner, mug: Part
) -> None:
    result = planner.answer(mug, REQUEST, place_at(mug, 1.6)).result
    assert result.code == ErrorCode.ALL_GRASPS_BLOCKED
    assert not result.grasps
    assert set(result.funnel.screened) <= {"arm", "support"}
    assert result.funnel.screened["arm"] > 0
    assert not result.funnel.blocked  # known before any hand was closed


def test_a_plan_for_one_pose_is_held_against_the_arm_at_another(
    planner: GraspPlanner, mug: Part
) -> None:
    near = planner.answer(mug, REQUEST, place_at(mug, 0.55)).result
    same = planner.answer(mug, REQUEST, place_at(mug, 0.55), known=near)
    assert same.from_known
    beside = planner.known_answer(mug, near, REQUEST, place_at(mug, 0.65))
    assert not beside.same_place
    for grasp in beside.answer.result.grasps:
        assert grasp.arm is not None
        palm = place_at(mug, 0.65).T_world_object @ grasp.T_object_palm
        np.testing.assert_allclose(dh_flange("six_axis", grasp.arm.grasp), palm, atol=1e-8)
    far = planner.known_answer(mug, near, REQUEST, place_at(mug, 1.6)).answer.result
    assert not far.grasps
    assert far.code == ErrorCode.ALL_GRASPS_BLOCKED
    assert "arm's reach" in far.message


def test_the_weight_orders_by_manipulability(mug: Part) -> None:
    settings = ArmSettings(model="six_axis", manipulability_weight=10.0)
    planner = GraspPlanner(PlannerSettings(arm=settings))
    request = replace(REQUEST, n_grasps=10)
    grasps = planner.answer(mug, request, place_at(mug, 0.55)).result.grasps
    shares = [grasp.arm.manipulability for grasp in grasps if grasp.arm is not None]
    assert len(shares) == len(grasps) > 2
    # ten times the share outweighs what epsilon and volume differ by, to within that difference
    spread = max(g.epsilon + g.volume for g in grasps)
    assert all(a >= b - 0.1 * spread for a, b in itertools.pairwise(shares))
