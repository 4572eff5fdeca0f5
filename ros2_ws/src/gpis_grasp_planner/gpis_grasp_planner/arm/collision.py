"""The arm's bodies against its surroundings, the part, the hand that it carries, and itself.

Distances are those of coal (the collision library of Pinocchio) between exact shapes; balls about
the shapes say first which pairs can be near at all.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.arm.description import ArmDescription
from gpis_grasp_planner.arm.kinematics import link_poses
from gpis_grasp_planner.arm.urdf import Body
from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.surroundings.obstacles import BoxObstacle, SupportPlane, Surroundings

Array = NDArray[np.float64]

# What turns with the first joint stays where it stands; the base may stand on the support.
_FIRST_AGAINST_SUPPORT = 2
_FIRST_AGAINST_BODIES = 1


@dataclass(frozen=True, eq=False)
class _Thing:
    """What stands still in the base's frame: a shape of coal at a pose, and a ball about it."""

    name: str
    shape: Any
    pose: Any
    middle: Array
    radius: float  # infinite for a half space
    first_link: int


class ArmCollision:
    """Collision of one arm at one place.

    Parameters
    ----------
    arm : ArmDescription
    hand : HandDescription
    around : Surroundings
        In the base's frame.
    part : TriangleMesh
    T_base_object : (4, 4) array
    margin_m : float [m]

    Notes
    -----
    Support: all links but the base and the first. Obstacles and part: all links. Hand: all links
    but the last two, which are beside it. Self: links with two others between them or one, but for
    the pairs of `ArmDescription.may_touch`.
    """

    def __init__(
        self,
        arm: ArmDescription,
        hand: HandDescription,
        around: Surroundings,
        part: TriangleMesh,
        T_base_object: Array,
        margin_m: float,
    ):
        self._coal = coal = _library(arm)
        self._arm, self._hand = arm, hand
        bodies = arm.chain.bodies
        self._bodies = bodies
        self._shapes = [_shape(coal, body) for body in bodies]
        self._link = np.array([body.link for body in bodies], dtype=np.int64)
        self._T_link_shape = np.array([body.T_link_shape for body in bodies]).reshape(-1, 4, 4)
        self._radius = np.array([body.radius for body in bodies])
        self._request = coal.CollisionRequest()
        self._request.security_margin = margin_m
        self._margin = margin_m
        self._things = [_thing(coal, body) for body in _bodies_of(around)]
        self._part = [_mesh_thing(coal, "part", part, T_base_object)]
        pairs = [
            (i, j)
            for i in range(len(bodies))
            for j in range(i + 1, len(bodies))
            if abs(bodies[i].link - bodies[j].link) > 1
            and tuple(sorted((bodies[i].link, bodies[j].link))) not in arm.may_touch
        ]
        self._pairs = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        self._pieces = _hand_pieces(hand)

    def first_contact(self, joints: Array, posture: Array, part: bool) -> str | None:
        """What the arm first comes too near to on a way; None where it is free.

        Parameters
        ----------
        joints : (K, n) array [rad]
        posture : (J,) array [rad]
            Of the hand that is carried.
        part : bool
            Whether the part stands where it lies (on the approach), or goes with the hand.
        """
        T = link_poses(self._arm.chain, joints)
        T_shape = T[:, self._link] @ self._T_link_shape
        middle = T_shape[..., :3, 3]
        things = self._things + (self._part if part else [])
        for thing in things:
            gap = np.linalg.norm(middle - thing.middle, axis=-1) - self._radius - thing.radius
            near = (gap < self._margin) & (self._link >= thing.first_link)
            for k, i in np.argwhere(near):
                if self._meet(self._shapes[i], self._pose(T_shape[k, i]), thing.shape, thing.pose):
                    return thing.name
        one, other = self._pairs
        gap = np.linalg.norm(middle[:, one] - middle[:, other], axis=-1)
        gap -= self._radius[one] + self._radius[other]
        for k, pair in np.argwhere(gap < self._margin):
            i, j = one[pair], other[pair]
            if self._meet(
                self._shapes[i], self._pose(T_shape[k, i]),
                self._shapes[j], self._pose(T_shape[k, j]),
            ):  # fmt: skip
                return "itself"
        return self._hand_contact(T, T_shape, posture)

    def _hand_contact(self, T: Array, T_shape: Array, posture: Array) -> str | None:
        watched = np.flatnonzero(self._link <= self._arm.n_joints - 2)
        pieces = self._pieces
        T_palm_link = link_transforms(self._hand, posture)[0][pieces.link]
        T_piece = (T[:, -1] @ self._arm.T_flange_palm)[:, None] @ T_palm_link
        middle = np.einsum("kpij,pj->kpi", T_piece[..., :3, :3], pieces.middle)
        middle += T_piece[..., :3, 3]
        gap = np.linalg.norm(middle[:, :, None] - T_shape[:, watched][:, None, :, :3, 3], axis=-1)
        gap -= pieces.radius[:, None] + self._radius[watched]
        for k, p, w in np.argwhere(gap < self._margin):
            if self._meet(
                self._shapes[watched[w]], self._pose(T_shape[k, watched[w]]),
                pieces.shapes[p], self._pose(T_piece[k, p]),
            ):  # fmt: skip
                return "hand"
        return None

    def _meet(self, one: Any, T_one: Any, other: Any, T_other: Any) -> bool:
        result = self._coal.CollisionResult()
        return bool(self._coal.collide(one, T_one, other, T_other, self._request, result))

    def _pose(self, T: Array) -> Any:
        return self._coal.Transform3s(np.array(T[:3, :3]), np.array(T[:3, 3]))


def _library(arm: ArmDescription) -> Any:
    try:
        import coal
    except ImportError as error:
        raise RequestError(
            f"An arm is set ({arm.name}), and the library for its collisions is not installed: "
            f"{error}. Install the extra 'arm' of gpis_grasp_planner, or leave arm.model empty."
        ) from error
    return coal


def _shape(coal: Any, body: Body) -> Any:
    if body.shape == "cylinder":
        return coal.Cylinder(*body.size)
    if body.shape == "sphere":
        return coal.Sphere(*body.size)
    return coal.Box(*body.size)


def _bodies_of(around: Surroundings) -> list[Any]:
    support = [] if around.support is None else [around.support]
    return [*support, *around.obstacles]


def _thing(coal: Any, body: Any) -> _Thing:
    if isinstance(body, SupportPlane):
        shape = coal.Halfspace(np.array(body.normal), float(body.normal @ body.point))
        return _Thing(
            body.name, shape, coal.Transform3s(), np.zeros(3), np.inf, _FIRST_AGAINST_SUPPORT
        )
    if isinstance(body, BoxObstacle):
        pose = coal.Transform3s(np.array(body.pose[:3, :3]), np.array(body.pose[:3, 3]))
        radius = 0.5 * float(np.linalg.norm(body.size))
        # a box may be a sheet, which coal takes with a thickness
        shape = coal.Box(*np.maximum(body.size, 1e-6))
        return _Thing(body.name, shape, pose, body.pose[:3, 3], radius, _FIRST_AGAINST_BODIES)
    return _mesh_thing(coal, body.name, body.mesh, body.pose)


def _mesh_thing(coal: Any, name: str, mesh: TriangleMesh, T: Array) -> _Thing:
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    center = 0.5 * (low + high)
    radius = float(np.linalg.norm(mesh.vertices - center, axis=1).max())
    pose = coal.Transform3s(np.array(T[:3, :3]), np.array(T[:3, 3]))
    return _Thing(
        name,
        _tree(coal, mesh),
        pose,
        T[:3, :3] @ center + T[:3, 3],
        radius,
        _FIRST_AGAINST_BODIES,
    )


_TREES: dict[str, Any] = {}


def _tree(coal: Any, mesh: TriangleMesh) -> Any:
    """The tree of a mesh's triangles, kept for the last few meshes."""
    key = mesh.content_hash
    if key not in _TREES:
        tree = coal.BVHModelOBBRSS()
        tree.beginModel(len(mesh.faces), len(mesh.vertices))
        tree.addVertices(np.asarray(mesh.vertices, dtype=float))
        tree.addTriangles(np.asarray(mesh.faces))
        tree.endModel()
        while len(_TREES) >= 8:
            _TREES.pop(next(iter(_TREES)))
        _TREES[key] = tree
    return _TREES[key]


@dataclass(frozen=True, eq=False)
class _Pieces:
    """A hand's P convex pieces, with balls about them, in the frames of their links."""

    link: NDArray[np.int64]
    shapes: tuple[Any, ...]
    middle: Array
    radius: Array


@lru_cache(maxsize=8)
def _hand_pieces(hand: HandDescription) -> _Pieces:
    import coal

    pieces = [
        (link, np.asarray(piece.vertices, dtype=float))
        for link, group in enumerate(hand.link_collision)
        for piece in group
    ]
    middle = np.array([0.5 * (p.min(axis=0) + p.max(axis=0)) for _, p in pieces])
    radius = [
        float(np.linalg.norm(p - m, axis=1).max()) for (_, p), m in zip(pieces, middle, strict=True)
    ]
    return _Pieces(
        np.array([link for link, _ in pieces], dtype=np.int64),
        tuple(_convex(coal, p) for _, p in pieces),
        middle,
        np.array(radius),
    )


def _convex(coal: Any, points: Array) -> Any:
    vertices = coal.StdVec_Vec3s()
    vertices.extend(list(points))
    return coal.Convex.convexHull(vertices, True, "Qt")
