"""Verdicts of clearance against coal, an independent collision library, on hands at random."""

from __future__ import annotations

from dataclasses import replace

import coal
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.hand_motion import motions_of
from gpis_grasp_planner.hand.drive import joints_from_motors, motors_from_joints
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.quality.figures import Quality
from gpis_grasp_planner.surroundings.clearance import Cause, clear_grasps
from gpis_grasp_planner.surroundings.clearance_settings import ClearanceSettings
from gpis_grasp_planner.surroundings.obstacles import (
    BoxObstacle,
    MeshObstacle,
    SupportPlane,
    Surroundings,
)

MARGIN = 0.003
SETTINGS = ClearanceSettings(margin_m=MARGIN)
# the bow of the closing that is held against a grasp, and the coarseness of the referee's samples
SLACK = 6e-4
NONE = Contacts(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=np.intp))


def random_hands(hand, n, rng):
    """Hands somewhere within 0.3 m that close from open by the drive's law, with breakaway."""
    T = transform(Rotation.random(n, rng=rng).as_matrix(), rng.uniform(-0.3, 0.3, (n, 3)))
    spread = rng.uniform(0.0, np.pi, (n, 1))
    inner = rng.uniform(0.2, 2.0, (n, 3))
    motor = inner + rng.uniform(0.0, 0.4, (n, 3)) * (rng.random((n, 3)) < 0.5)
    opened = joints_from_motors(hand, spread, np.zeros((n, 3)))
    closed = joints_from_motors(hand, spread, motor, inner[..., None])
    return [
        Grasp(T[k], closed[k], opened[k], NONE, Quality(0.1, 0.1), T[k, :3, 2].copy(), 0.1)
        for k in range(n)
    ]


def closest(referee, grasp, body, T_object_body):
    return min(referee.distance(poses, body, T_object_body) for poses in referee.way(grasp))


def cause_by_referee(referee, hand, grasp, body, T_object_body, margin):
    """The first phase that comes nearer than the margin, or None."""
    palm = {i for i, group in enumerate(hand.link_friction_group) if group == "palm"}
    fingers = set(range(hand.n_links)) - palm
    way = list(referee.way(grasp, n_back=9))
    phases = [
        (Cause.PALM, way[-1:], palm),
        (Cause.FINGER, way[-1:], fingers),
        (Cause.PREGRASP, way[8:9], fingers),
        (Cause.CLOSING, way[8:], fingers),
        (Cause.APPROACH, way[:9], None),
    ]
    for cause, poses, links in phases:
        if min(referee.distance(p, body, T_object_body, links) for p in poses) < margin:
            return cause
    return None


def check(referee, hand, grasps, surroundings, body, T_object_body):
    """Every verdict agrees with the referee's, but for distances within the slack."""
    found = clear_grasps(hand, grasps, surroundings, SETTINGS)
    causes = set()
    for k, (grasp, clearance) in enumerate(zip(grasps, found, strict=True)):
        strict = cause_by_referee(referee, hand, grasp, body, T_object_body, MARGIN - 1e-6)
        loose = cause_by_referee(referee, hand, grasp, body, T_object_body, MARGIN + SLACK)
        assert clearance.cause in (strict, loose), (k, clearance, strict, loose)
        if strict is not None:
            assert not clearance.clear, (k, clearance, strict)
        causes.add(clearance.cause)
    return causes


@pytest.mark.parametrize("seed", [0, 1])
def test_a_plane_is_judged_as_by_coal(planner, referee, seed):
    rng = np.random.default_rng(seed)
    normal = rng.standard_normal(3)
    normal /= np.linalg.norm(normal)
    plane = SupportPlane(rng.uniform(-0.1, 0.1, 3) - 0.15 * normal, 3.0 * normal)
    body = coal.Halfspace(normal, float(normal @ plane.point))
    grasps = random_hands(planner.hand, 60, rng)
    seen = check(referee, planner.hand, grasps, Surroundings(plane), body, np.eye(4))
    assert seen >= {None, Cause.PALM, Cause.FINGER}, seen


@pytest.mark.parametrize("as_mesh", [False, True])
def test_a_box_is_judged_as_by_coal(planner, referee, as_mesh):
    rng = np.random.default_rng(2)
    pose = transform(Rotation.random(rng=rng).as_matrix(), rng.uniform(-0.1, 0.1, 3))
    size = np.array([0.3, 0.12, 0.02])
    grasps = random_hands(planner.hand, 60, rng)
    solid = trimesh.creation.box(size).subdivide()
    mesh = TriangleMesh(np.array(solid.vertices), np.array(solid.faces, np.int32))
    obstacle = MeshObstacle(pose, mesh) if as_mesh else BoxObstacle(pose, size)
    around = Surroundings(None, (obstacle,))
    seen = check(referee, planner.hand, grasps, around, coal.Box(*size), pose)
    assert len(seen) >= 4, seen


def test_distance_from_a_plane_is_that_of_coal(planner, referee):
    rng = np.random.default_rng(3)
    plane = SupportPlane(np.array([0.0, 0.0, -0.5]), np.array([0.0, 0.0, 1.0]))
    grasps = random_hands(planner.hand, 20, rng)
    found = clear_grasps(planner.hand, grasps, Surroundings(plane), SETTINGS)
    for grasp, clearance in zip(grasps, found, strict=True):
        truth = closest(referee, grasp, coal.Halfspace(np.array([0.0, 0.0, 1.0]), -0.5), np.eye(4))
        assert clearance.nearest == "support"
        assert truth - SLACK <= clearance.distance_m <= truth + 1e-9


def test_something_thin_between_two_places_of_the_approach_is_met(planner):
    """A wire of a tenth of a millimetre across the way of the palm, whichever way it lies."""
    hand = planner.hand
    grasp = random_hands(hand, 1, np.random.default_rng(4))[0]
    for share in np.linspace(0.05, 0.95, 13):
        T = grasp.T_object_palm.copy()
        base = hand.link_collision[0][0].vertices[:, 2].min()
        T[:3, 3] += T[:3, :3] @ [0.0, 0.0, base - share * grasp.approach_distance]
        wire = BoxObstacle(T, np.array([0.5, 1e-4, 1e-4]), "wire")
        [found] = clear_grasps(hand, [grasp], Surroundings(None, (wire,)), SETTINGS)
        assert (found.cause, found.nearest, found.distance_m) == (Cause.APPROACH, "wire", 0.0)


def test_the_bow_covers_the_arc_between_samples(planner):
    """No vertex on a path sampled 40 times as densely leaves the chord by more than the bow."""
    hand = planner.hand
    grasps = random_hands(hand, 12, np.random.default_rng(5))
    motions = motions_of(hand, grasps)
    assert motions.bow.max() < 4e-4
    for k, grasp in enumerate(grasps):
        _, end = motors_from_joints(hand, grasp.joints)
        held = hand.of_fingers(grasp.joints)[:, :1]
        for index, finger in enumerate(hand.fingers):
            m = np.linspace(0.0, end[0, index], 1000)
            motor = np.zeros((1000, 3))
            motor[:, index] = m
            joints = joints_from_motors(
                hand, np.full((1000, 1), grasp.joints[0]), motor, held[None]
            )
            dense = grasp.T_object_palm @ link_transforms(hand, joints)[:, finger.distal_link]
            coarse = motions.T[k, :, finger.distal_link]
            vertices = hand.link_collision[finger.distal_link][0].vertices[::9]
            for v in np.c_[vertices, np.ones(len(vertices))]:
                path, knots = (dense @ v)[:, :3], (coarse @ v)[:, :3]
                a, b = knots[:-1], knots[1:]
                along = b - a
                s = ((path[:, None] - a) * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-30)
                foot = a + np.clip(s, 0.0, 1.0)[..., None] * along
                off = np.linalg.norm(path[:, None] - foot, axis=-1).min(axis=1)
                assert off.max() <= motions.bow[k] + 1e-9


def test_a_hand_wholly_inside_a_closed_mesh_is_blocked(planner):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=2.0)
    mesh = TriangleMesh(np.array(ball.vertices), np.array(ball.faces, np.int32))
    around = Surroundings(None, (MeshObstacle(np.eye(4), mesh, "rock"),))
    for clearance in clear_grasps(
        planner.hand, random_hands(planner.hand, 5, np.random.default_rng(6)), around, SETTINGS
    ):
        assert (clearance.cause, clearance.distance_m) == (Cause.PALM, 0.0)


@pytest.mark.parametrize("body", ["plane", "box", "mesh"])
def test_a_clearance_does_not_depend_on_the_batch(planner, body):
    """Neither near nor beyond twice the margin, where distances are bounds."""
    rng = np.random.default_rng(9)
    grasps = random_hands(planner.hand, 40, rng)
    short = [  # closed almost: their own moves are few
        replace(g, pregrasp_joints=g.pregrasp_joints + share * (g.joints - g.pregrasp_joints))
        for g, share in zip(grasps, rng.uniform(0.8, 1.0, 40), strict=True)
    ]
    solid = trimesh.creation.icosphere(subdivisions=2, radius=0.08)
    mesh = TriangleMesh(np.array(solid.vertices), np.array(solid.faces, np.int32))
    around = {
        "plane": Surroundings(SupportPlane(np.array([0.0, 0.0, -0.2]), np.array([0.0, 0.0, 1.0]))),
        "box": Surroundings(None, (BoxObstacle(np.eye(4), np.array([0.1, 0.2, 0.1])),)),
        "mesh": Surroundings(None, (MeshObstacle(np.eye(4), mesh),)),
    }[body]
    together = clear_grasps(planner.hand, [*grasps, *short], around, SETTINGS)
    for grasp, found in zip([*grasps, *short], together, strict=True):
        [alone] = clear_grasps(planner.hand, [grasp], around, SETTINGS)
        assert (found.cause, found.nearest) == (alone.cause, alone.nearest)
        assert found.distance_m == pytest.approx(alone.distance_m, abs=1e-12)


def test_verdicts_do_not_depend_on_the_frame(planner):
    rng = np.random.default_rng(7)
    grasps = random_hands(planner.hand, 30, rng)
    world = Surroundings(
        SupportPlane(np.array([0.0, 0.0, -0.2]), np.array([0.0, 0.0, 1.0])),
        (BoxObstacle(np.eye(4), np.array([0.1, 0.2, 0.1])),),
    )
    first = clear_grasps(planner.hand, grasps, world, SETTINGS)
    T = transform(Rotation.random(rng=rng).as_matrix(), rng.uniform(-1, 1, 3))
    elsewhere = [
        Grasp(T @ g.T_object_palm, g.joints, g.pregrasp_joints, NONE, Quality(0.1, 0.1),
              T[:3, :3] @ g.approach_direction, 0.1)
        for g in grasps
    ]  # fmt: skip
    again = clear_grasps(planner.hand, elsewhere, world.moved(T), SETTINGS)
    for a, b in zip(first, again, strict=True):
        assert a.cause == b.cause
        assert a.distance_m == pytest.approx(b.distance_m, abs=1e-8)


def test_nothing_around_blocks_nothing(planner):
    grasps = random_hands(planner.hand, 3, np.random.default_rng(8))
    for clearance in clear_grasps(planner.hand, grasps, Surroundings(), SETTINGS):
        assert clearance.clear
        assert clearance.distance_m == np.inf
    assert clear_grasps(planner.hand, [], Surroundings(), SETTINGS) == []
