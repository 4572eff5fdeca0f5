"""Parts, contexts and attempts for the planner's tests, and oracles that share no code with it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import coal
import numpy as np
import pytest
import trimesh
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.grasp.evaluator import Attempts, AttemptStatus
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.quality.objective import EpsilonVolume
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.search.archive import GraspArchive
from gpis_grasp_planner.search.context import PlanningContext
from gpis_grasp_planner.search.finalists import choose_finalists, choose_reserve
from gpis_grasp_planner.search.hpp_opt import PalmPoseOptimiser
from gpis_grasp_planner.search.searches import make_search

SPHERE_RADIUS = 0.035
FRICTION = Friction(finger=0.6, palm=0.6)


def make_part(mesh_id, solid, friction=FRICTION):
    """Part of a trimesh solid about the origin, at 1000 kg/m^3."""
    mesh = TriangleMesh(np.array(solid.vertices, dtype=float), np.array(solid.faces, np.int32))
    volume = float(solid.volume)
    return Part(mesh_id, mesh, np.zeros(3), 1000.0 * volume, volume, True, friction)


def make_attempts(T, epsilon, volume=None, status=None, n_joints=8):
    """Attempts (B) with the given figures and no contacts."""
    T = np.asarray(T, dtype=float)
    n = len(T)
    status = np.full(n, AttemptStatus.GRASPED) if status is None else np.asarray(status)
    return Attempts(
        T_object_palm=T,
        preshape=np.zeros((n, 1)),
        status=status.astype(np.int64),
        joints=np.zeros((n, n_joints)),
        n_contacts=np.zeros(n, dtype=np.int64),
        positions=np.zeros((n, 24, 3)),
        normals_inward=np.zeros((n, 24, 3)),
        friction=np.zeros((n, 24)),
        links=np.zeros((n, 24), dtype=np.int64),
        epsilon=np.asarray(epsilon, dtype=float),
        volume=np.zeros(n) if volume is None else np.asarray(volume, dtype=float),
    )


def pose_angle_and_shift(T_1, T_2):
    """Geodesic angle [rad] from the trace, and distance of the origins [m]."""
    cosine = (np.trace(T_1[:3, :3].T @ T_2[:3, :3]) - 1.0) / 2.0
    return float(np.arccos(np.clip(cosine, -1.0, 1.0))), float(np.linalg.norm((T_1 - T_2)[:3, 3]))


def apart(T_1, T_2, max_radius):
    """The distance rule of the list of grasps, written again."""
    angle, shift = pose_angle_and_shift(T_1, T_2)
    return max(shift / max_radius, angle / (2.0 * np.pi))


def hull_figures(contacts, center_of_mass, torque_scale, edges):
    """Epsilon and volume of the L1 wrench hull, edge by edge."""
    wrenches = []
    for p, n, mu in zip(
        contacts.positions, contacts.normals_inward, contacts.friction, strict=True
    ):
        t_y = np.cross(n, [1.0, 0.0, 0.0])
        t_y /= np.linalg.norm(t_y)
        t_x = np.cross(t_y, n)
        for k in range(edges):
            angle = 2.0 * np.pi * k / edges
            force = n + mu * (np.cos(angle) * t_x + np.sin(angle) * t_y)
            torque = np.cross(p - center_of_mass, force) / torque_scale
            wrenches.append(np.concatenate([force, torque]))
    hull = ConvexHull(np.array(wrenches), qhull_options="Qt Qx Q12")
    nearest = -hull.equations[:, -1].max()
    return (nearest if nearest > 0.0 else -1.0), float(hull.volume)


def convex_overlap(A, B):
    """Whether the hulls of two point sets overlap: a linear programme looks for a plane between.

    Maximises the width s of the slab ``a.x >= b + s`` on A and ``a.x <= b`` on B over |a_i| <= 1.
    """
    n, m = len(A), len(B)
    rows = np.block(
        [[-A, np.ones((n, 1)), np.ones((n, 1))], [B, -np.ones((m, 1)), np.zeros((m, 1))]]
    )
    bounds = [(-1.0, 1.0)] * 3 + [(None, None), (0.0, None)]
    solution = linprog([0, 0, 0, 0, -1.0], A_ub=rows, b_ub=np.zeros(n + m), bounds=bounds)
    return solution.x[4] <= 1e-9


def rotation_about(axis, angle):
    """Rodrigues' formula, (3, 3)."""
    x, y, z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K


def posed_links(hand, T_object_palm, joints):
    """Convex pieces of every link (list of (n, 3) vertex arrays per link) in the object's frame.

    The kinematic chain is walked again here, joint by joint.
    """
    T = []
    for link, parent in enumerate(hand.link_parent):
        here = T_object_palm if parent < 0 else T[parent] @ hand.T_parent_joint[link]
        joint = hand.link_joint[link]
        if joint >= 0:
            turn = np.eye(4)
            turn[:3, :3] = rotation_about(hand.joint_axis[link], joints[joint])
            here = here @ turn
        T.append(here)
    return [
        [piece.vertices @ T[link][:3, :3].T + T[link][:3, 3] for piece in pieces]
        for link, pieces in enumerate(hand.link_collision)
    ]


@pytest.fixture(scope="session")
def oracle():
    """The functions above."""
    return SimpleNamespace(
        make_part=make_part,
        make_attempts=make_attempts,
        pose_angle_and_shift=pose_angle_and_shift,
        apart=apart,
        hull_figures=hull_figures,
        convex_overlap=convex_overlap,
        rotation_about=rotation_about,
        posed_links=posed_links,
    )


@pytest.fixture(scope="session")
def catalogue():
    return MeshCatalogue([default_catalogue_directory()])


@pytest.fixture(scope="session")
def planner():
    """One planner for all tests, so that an object is prepared once."""
    return GraspPlanner()


@pytest.fixture(scope="session")
def sphere():
    """A ball of 70 mm, convex, with 642 vertices on the sphere."""
    return make_part("ball", trimesh.creation.icosphere(subdivisions=3, radius=SPHERE_RADIUS))


@pytest.fixture(scope="session")
def make_context(planner):
    """Context of a part as the planner makes it, with settings and evaluator of one's choice."""

    def make(part, seed=0, settings=None, evaluator=None, friction=FRICTION):
        settings = settings or PlannerSettings()
        prepared = planner.prepare(part)
        return PlanningContext(
            part=part,
            hand=planner.hand,
            evaluator=evaluator
            or CompiledEvaluator(
                planner.hand, part, friction, settings.scene, prepared.field, prepared.tree
            ),
            atlas=prepared.atlas,
            archive=GraspArchive(part.max_radius, EpsilonVolume(settings.hpp.volume_weight)),
            settings=settings.search,
            rng=np.random.default_rng(seed),
        )

    return make


@pytest.fixture(scope="module")
def searched_mug(make_context, catalogue):
    """Context of the mug after a short search."""
    context = make_context(catalogue.load("mug"), seed=1)
    search = PalmPoseOptimiser(context)
    while context.evaluator.n_attempts < 300:
        search.step()
    return context


class RecordingEvaluator:
    """Takes poses, answers with prepared figures: a search can be watched without a hand.

    Attributes
    ----------
    attempts, cleared : list
        Arguments of the calls, in order.
    free : callable
        (n,) -> (n,) bool, which of n hands come free.
    figures : callable
        (T (n, 4, 4), pre-shape (n, 1)) -> epsilon (n,).
    """

    friction = FRICTION
    n_states = 0

    def __init__(self, figures=None, free=None):
        self.figures = figures or (lambda T, spread: np.full(len(T), 0.1))
        self.free = free or (lambda n: np.ones(n, dtype=bool))
        self.n_attempts = 0
        self.attempts = []
        self.cleared = []

    def _postures(self, *_):
        raise AssertionError("a search that is watched here must not need postures")

    postures = attempt_from = approach = guided_potential = _postures

    def attempt(self, T_object_palm, spread):
        self.attempts.append((np.array(T_object_palm), np.array(spread)))
        self.n_attempts += len(T_object_palm)
        result = make_attempts(T_object_palm, self.figures(T_object_palm, spread))
        result.preshape[:] = spread
        return result

    def clear_palm(self, T_object_palm, normals_outward, spread, standoff):
        arrays = (T_object_palm, normals_outward, spread, standoff)
        self.cleared.append(tuple(np.array(a) for a in arrays))
        moved = np.array(T_object_palm)
        moved[:, :3, 3] += standoff[:, None] * normals_outward
        return moved, self.free(len(moved))


@pytest.fixture
def recording_evaluator():
    return RecordingEvaluator


class CoalReferee:
    """The hand's pieces in an independent collision library, on a path walked here."""

    def __init__(self, hand):
        self.hand = hand
        self.pieces = [
            (link, self.convex(piece.vertices, piece.faces))
            for link, group in enumerate(hand.link_collision)
            for piece in group
        ]

    @staticmethod
    def convex(vertices, faces):
        points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        for p in vertices:
            points.append(np.array(p, dtype=float))
        for a, b, c in faces:
            triangles.append(coal.Triangle(int(a), int(b), int(c)))
        return coal.Convex(points, triangles)

    def link_poses(self, T_frame_palm, joints):
        """Poses (4, 4) of all links, joint by joint."""
        T = []
        for link, parent in enumerate(self.hand.link_parent):
            here = T_frame_palm if parent < 0 else T[parent] @ self.hand.T_parent_joint[link]
            joint = self.hand.link_joint[link]
            if joint >= 0:
                turn = np.eye(4)
                turn[:3, :3] = rotation_about(self.hand.joint_axis[link], joints[joint])
                here = here @ turn
            T.append(here)
        return T

    def postures(self, grasp, n):
        """(n, J) postures while the fingers close: coupled, then the distal link by itself."""
        path = np.repeat(grasp.joints[None], n, axis=0)
        for finger in self.hand.fingers:
            i, d = finger.inner_joint, finger.distal_joint
            opened, closed = grasp.pregrasp_joints[[i, d]], grasp.joints[[i, d]]
            motor = np.linspace(0.75 * opened.sum(), 0.75 * closed.sum(), n)
            path[:, i] = np.minimum(motor, closed[0])
            path[:, d] = np.clip(4.0 / 3.0 * motor - path[:, i], 0.0, closed[1])
        path[0] = grasp.pregrasp_joints
        return path

    def way(self, grasp, n_back=9, n_closing=30):
        """Link poses in the object's frame: the approach, then the closing; the last is closed."""
        for s in np.linspace(1.0, 0.0, n_back):
            T = grasp.T_object_palm.copy()
            T[:3, 3] -= s * grasp.approach_distance * grasp.approach_direction
            yield self.link_poses(T, grasp.pregrasp_joints)
        for joints in self.postures(grasp, n_closing)[1:]:
            yield self.link_poses(grasp.T_object_palm, joints)

    def distance(self, poses, body, T_object_body, links=None):
        """Smallest distance of the pieces at link poses from a coal body; negative in overlap."""
        pose = coal.Transform3s(T_object_body[:3, :3], T_object_body[:3, 3])
        request = coal.DistanceRequest()
        return min(
            coal.distance(
                shape,
                coal.Transform3s(poses[link][:3, :3], poses[link][:3, 3]),
                body,
                pose,
                request,
                coal.DistanceResult(),
            )
            for link, shape in self.pieces
            if links is None or link in links
        )


@pytest.fixture(scope="session")
def referee(planner):
    return CoalReferee(planner.hand)


@pytest.fixture(scope="session")
def mug_plan(catalogue, planner, make_context):
    """The shipped mug: part, plan with a reserve, and the context it was searched in."""
    part = catalogue.load("mug")
    context = make_context(part, seed=1)
    search = make_search("dual", context)
    while not search.finished and context.evaluator.n_attempts < 1200:
        search.step()
    grasps = choose_finalists(context, 20, None)
    request = PlanRequest(max_evaluations=32, time_budget_s=60.0, n_grasps=20)
    result = replace(
        planner.plan(part, request),
        code=ErrorCode.SUCCESS,
        grasps=grasps,
        reserve=choose_reserve(context, grasps),
    )
    return SimpleNamespace(part=part, context=context, result=result)
