"""A kept plan answers for any place: a mug on a table, lying and upright, judged by coal."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import coal
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.grasp.reserve import Reserve
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.surroundings.clearance import Cause
from gpis_grasp_planner.surroundings.clearance_settings import ClearanceSettings
from gpis_grasp_planner.surroundings.obstacles import BoxObstacle, SupportPlane, Surroundings
from gpis_grasp_planner.surroundings.place import Place

SEED = 20
POSES = 200
SETTINGS = ClearanceSettings()
FAR_BELOW = Surroundings(SupportPlane(np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])))
TABLE = Surroundings(SupportPlane(np.array([0.3, -0.2, 0.75]), np.array([0.0, 0.0, 1.0])))


def known_at(planner, plan, place, n_grasps):
    """What the planner answers for a place from a plan alone."""
    request = PlanRequest(n_grasps=n_grasps, time_budget_s=60.0)
    return planner.known_answer(plan.part, plan.result, request, place).answer


def resting_rotations(part):
    """Rotations that put each face of the hull down that the centre of mass stands over."""
    hull = ConvexHull(part.mesh.vertices)
    faces = np.unique(np.round(hull.equations, 6), axis=0)
    rotations = []
    for normal, offset in zip(faces[:, :3], faces[:, 3], strict=True):
        R = Rotation.align_vectors([[0.0, 0.0, -1.0]], [normal])[0].as_matrix()
        on_face = hull.points[np.abs(hull.points @ normal + offset) < 1e-5]
        corners = (on_face @ R.T)[:, :2]
        if np.linalg.matrix_rank(corners - corners[0], tol=1e-6) < 2:
            continue
        inside = ConvexHull(corners).equations @ [*(R @ part.center_of_mass)[:2], 1.0]
        if inside.max() < 0.0:
            rotations.append(R)
    return rotations


def random_place(part, rotations, rng):
    """T_world_object of the mug on the table, at a random place and heading; half lying."""
    lying = rng.random() < 0.5
    rotations = [R for R in rotations if (abs(R[2, 2]) < 0.5) == lying]
    R = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi)).as_matrix()
    R = R @ rotations[rng.integers(len(rotations))]
    height = TABLE.support.point[2] - (part.mesh.vertices @ R[2]).min()
    return transform(R, np.array([*rng.uniform(-0.5, 0.5, 2), height]))


def test_no_answer_comes_through_the_table(mug_plan, planner, referee):
    """Through the planner, as the node and the command line ask for it."""
    opened = GraspPlanner(PlannerSettings(clearance=ClearanceSettings(pregrasp="open")))
    rng = np.random.default_rng(SEED)
    rotations = resting_rotations(mug_plan.part)
    up = [R[2, 2] for R in rotations]
    assert max(up) > 0.99  # upright
    assert min(map(abs, up)) < 0.3  # lying
    table = coal.Halfspace(np.array([0.0, 0.0, 1.0]), float(TABLE.support.point[2]))
    answered, through, walked = 0, 0, {}
    for number in range(POSES):
        T_world_object = random_place(mug_plan.part, rotations, rng)
        T_object_world = np.linalg.inv(T_world_object)
        answer = known_at(
            planner if number % 4 == 0 else opened, mug_plan, Place(T_world_object, TABLE), 4
        )
        if not answer.result.grasps:
            assert answer.result.code == ErrorCode.ALL_GRASPS_BLOCKED
            continue
        answered += 1
        assert answer.lift_direction == pytest.approx(T_world_object[2, :3], abs=1e-12)
        for grasp in answer.result.grasps:
            assert grasp.way_out == pytest.approx(answer.lift_direction)
            key = grasp.T_object_palm.tobytes() + grasp.pregrasp_joints.tobytes()
            if key not in walked:
                walked[key] = list(referee.way(grasp, n_back=5, n_closing=12))
            d = min(referee.distance(poses, table, T_object_world) for poses in walked[key])
            assert d >= SETTINGS.margin_m - 1e-6, f"seed {SEED}, pose {number}: {d}"
        # the test can fail: the plan's own grasps, made without the table, come through
        for grasp in mug_plan.result.grasps:
            T = T_world_object @ grasp.T_object_palm
            lowest = min(
                (pose[:3, :3] @ piece.vertices.T)[2].min() + pose[2, 3]
                for pose, pieces in zip(
                    referee.link_poses(T, grasp.joints), planner.hand.link_collision, strict=True
                )
                for piece in pieces
            )
            through += lowest < TABLE.support.point[2]
    print(f"seed {SEED}: {answered} of {POSES} answered, {through} grasps bad without")
    assert answered >= 0.95 * POSES
    assert through > 0.3 * POSES * len(mug_plan.result.grasps)


def test_grasps_have_their_exact_quality_and_stand_in_order(mug_plan, planner):
    T = random_place(mug_plan.part, resting_rotations(mug_plan.part), np.random.default_rng(0))
    answer = known_at(planner, mug_plan, Place(T, TABLE), 20)
    grasps = answer.result.grasps
    value = []
    for grasp in grasps:
        exact = grasp.recomputed_quality(
            mug_plan.result.center_of_mass,
            mug_plan.result.torque_scale,
            mug_plan.result.cone_edges,
        )
        assert (grasp.epsilon, grasp.volume) == pytest.approx((exact.epsilon, exact.volume))
        assert grasp.feasible
        value.append(exact.epsilon + mug_plan.context.settings.hpp.volume_weight * exact.volume)
    assert value == sorted(value, reverse=True)
    assert len(answer.clearances) == len(grasps)
    assert all(c.clear and c.distance_m >= SETTINGS.margin_m for c in answer.clearances)
    own = {g.T_object_palm.tobytes() for g in mug_plan.result.grasps}
    assert any(g.T_object_palm.tobytes() not in own for g in grasps), "none came from the reserve"


def test_all_blocked_is_a_code_with_the_causes(mug_plan, planner):
    room = Surroundings(None, (BoxObstacle(np.eye(4), np.full(3, 2.0), "rock"),))
    answer = known_at(planner, mug_plan, Place(surroundings=room), 20)
    kept = len(mug_plan.result.grasps) + len(mug_plan.result.reserve)
    assert answer.result.code == ErrorCode.ALL_GRASPS_BLOCKED
    assert answer.result.grasps == ()
    assert answer.blocked == {Cause.PALM: kept}
    assert answer.lift_direction is None
    assert f"palm {kept}" in answer.result.message
    assert "'rock'" in answer.result.message


def test_an_answer_without_grasps_stays_as_it_is(mug_plan, planner):
    nothing = replace(
        mug_plan.result, grasps=(), reserve=Reserve(), code=ErrorCode.NO_FEASIBLE_GRASP
    )
    empty = SimpleNamespace(part=mug_plan.part, result=nothing)
    answer = known_at(planner, empty, Place(surroundings=FAR_BELOW), 20)
    assert answer.result.code == ErrorCode.NO_FEASIBLE_GRASP
    assert answer.result.grasps == ()


def test_the_reserve_holds_other_grasps_than_the_answer(mug_plan, oracle):
    own = [g.T_object_palm for g in mug_plan.result.grasps]
    more = [g.T_object_palm for g in mug_plan.result.reserve.estimates]
    assert 50 <= len(more) <= 150
    radius = mug_plan.part.max_radius
    for i, T in enumerate(more):
        assert not any(np.array_equal(T, other) for other in own)
        assert all(oracle.apart(T, other, radius) >= 0.1 - 1e-9 for other in more[:i])


def test_a_narrow_pregrasp_keeps_off_the_part_and_closes_to_the_same_grasp(
    mug_plan, planner, referee
):
    part, hand = mug_plan.part, planner.hand
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(len(part.mesh.faces), len(part.mesh.vertices))
    mesh.addVertices(part.mesh.vertices)
    mesh.addTriangles(part.mesh.faces.astype(np.int64))
    mesh.endModel()
    answer = known_at(planner, mug_plan, Place(surroundings=FAR_BELOW), 12)
    before = {
        g.T_object_palm.tobytes(): g
        for g in (*mug_plan.result.grasps, *mug_plan.result.reserve.estimates)
    }
    moved = 0
    for grasp in answer.result.grasps:
        opened = before[grasp.T_object_palm.tobytes()].pregrasp_joints
        for finger in hand.fingers:
            if np.isclose(grasp.pregrasp_joints[finger.inner_joint], opened[finger.inner_joint]):
                continue
            moved += 1
            links = {finger.inner_link, finger.distal_link}
            for poses in [*referee.way(grasp, n_back=5)][:5]:
                gap = referee.distance(poses, mesh, np.eye(4), links)
                assert gap >= SETTINGS.pregrasp_clearance_m - 1e-6
    assert moved >= 12
    again = mug_plan.context.evaluator.attempt_from(
        np.stack([g.T_object_palm for g in answer.result.grasps]),
        np.stack([g.pregrasp_joints for g in answer.result.grasps]),
    )
    assert (again.status == 0).all()
    for k, grasp in enumerate(answer.result.grasps):
        # the closing stops within its tolerance of contact: that much of an arc at a fingertip
        assert np.abs(again.joints[k] - grasp.joints).max() < 5e-3
