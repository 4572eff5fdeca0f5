"""PyBullet behind one class: the hand's convex links and a concave object, and their distances.

This is the only module that imports pybullet. The object stays a concave triangle mesh, so that
the inside and the handle of a mug can be touched. Collision margins are nearly zero, because
PyBullet adds them to the shapes: with its default of 1 mm a distance is wrong by as much. PyBullet
(3.2.7) changes the margin of a body's base only, not of its links; so every convex piece of the
hand is a body of its own here, placed by the hand's kinematics.
"""

from __future__ import annotations

import importlib
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.transforms import apply, to_position_quat_xyzw
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree, nearest_point
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.kinematics import link_transforms

Array = NDArray[np.float64]
Faces = NDArray[np.integer[Any]]


def _import_quietly() -> ModuleType:
    """Import pybullet, whose C code greets on the standard error stream."""
    sys.stderr.flush()
    kept = os.dup(2)
    try:
        with Path(os.devnull).open("wb") as nothing:
            os.dup2(nothing.fileno(), 2)
            return importlib.import_module("pybullet")
    finally:
        os.dup2(kept, 2)
        os.close(kept)


pybullet = _import_quietly()

HULL_MARGIN_M = 1e-5
TRIANGLES_PER_BODY = 100_000
_SAME_DISTANCE = 1.001


def bullet_data_directory() -> Path:
    """The directory of the models that PyBullet ships."""
    return Path(importlib.import_module("pybullet_data").getDataPath())


@contextmanager
def bullet_client() -> Iterator[BulletClient]:
    """A PyBullet client without a window; its memory is freed at the end."""
    client = BulletClient(pybullet.connect(pybullet.DIRECT))
    client.setPhysicsEngineParameter(enableFileCaching=0)  # it would keep every file ever read
    try:
        yield client
    finally:
        client.disconnect()


class BulletClient:
    """PyBullet's functions bound to one client: ``client.stepSimulation()`` and so on."""

    def __init__(self, client_id: int):
        self.client_id = client_id

    def __getattr__(self, name: str) -> Any:
        value = getattr(pybullet, name)
        if not callable(value):
            return value

        def bound(*arguments: Any, **named: Any) -> Any:
            return value(*arguments, physicsClientId=self.client_id, **named)

        setattr(self, name, bound)
        return bound


@dataclass(frozen=True, eq=False)
class ClosestPoints:
    """Pairs of nearest points of a hand link and the object's triangles, in the object's frame.

    Attributes
    ----------
    on_link, on_object : (k, 3) arrays [m]
    normals_inward : (k, 3) array
        From the link into the object.
    distances : (k,) array [m]
        Negative where the link penetrates the triangle.
    """

    on_link: Array
    on_object: Array
    normals_inward: Array
    distances: Array

    def __len__(self) -> int:
        return len(self.distances)


class _Lists:
    """The lists through which meshes go to PyBullet, always the same ones.

    PyBullet (3.2.7) never gives back its references to the lists that it is handed: a new list
    for each mesh would stay in memory for ever. The largest mesh so far sets the size of these.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._rows: list[list[float]] = []
        self._vertices: list[list[float]] = []
        self._indices: list[int] = []

    def shape(self, client: BulletClient, vertices: Array, faces: Faces | None) -> int:
        """A collision shape: the triangles, or the hull of the vertices where there are none."""
        with self._lock:
            self._rows.extend([0.0, 0.0, 0.0] for _ in range(len(vertices) - len(self._rows)))
            for row, vertex in zip(self._rows, vertices.tolist(), strict=False):
                row[:] = vertex
            self._vertices[:] = self._rows[: len(vertices)]
            indices = {}
            if faces is not None:
                self._indices[:] = faces.ravel().tolist()
                indices["indices"] = self._indices
            shape = client.createCollisionShape(
                client.GEOM_MESH, vertices=self._vertices, **indices
            )
        return int(shape)


_lists = _Lists()


def hull_shape(client: BulletClient, points: Array) -> int:
    """The collision shape of the convex hull of points (n, 3) [m]."""
    return _lists.shape(client, points, None)


def convex_body(client: BulletClient, piece: TriangleMesh) -> int:
    """A fixed body with the hull of a convex piece, at the origin."""
    shape = hull_shape(client, piece.vertices)
    body = client.createMultiBody(baseMass=0.0, baseCollisionShapeIndex=shape)
    client.changeDynamics(body, -1, collisionMargin=HULL_MARGIN_M)
    return int(body)


def concave_bodies(client: BulletClient, mesh: TriangleMesh) -> list[int]:
    """Fixed bodies with the triangles of a mesh, at the origin.

    One for each `TRIANGLES_PER_BODY` triangles: PyBullet takes 174,762 of them and no more.
    """
    bodies = []
    for first in range(0, len(mesh.faces), TRIANGLES_PER_BODY):
        some: Faces = mesh.faces[first : first + TRIANGLES_PER_BODY]
        vertices = mesh.vertices
        if len(some) < len(mesh.faces):
            used, some = np.unique(some, return_inverse=True)
            vertices = vertices[used]
        shape = _lists.shape(client, vertices, some)
        body = client.createMultiBody(baseMass=0.0, baseCollisionShapeIndex=shape)
        client.changeDynamics(body, -1, collisionMargin=0.0)
        bodies.append(int(body))
    return bodies


class BulletWorld:
    """A hand beside an object at the origin, for questions about distances (no time passes).

    Use it as a context manager. A link that is wholly inside the object touches none of its
    triangles; the signed distance field tells that case.

    Parameters
    ----------
    hand : HandDescription
    mesh : TriangleMesh
    field, tree : DistanceField, TriangleTree, optional
        Made from the mesh if not given.
    """

    def __init__(
        self,
        hand: HandDescription,
        mesh: TriangleMesh,
        field: DistanceField | None = None,
        tree: TriangleTree | None = None,
    ):
        self.hand = hand
        self.mesh = mesh
        self.field = field or DistanceField.of(mesh)
        self.tree = tree or TriangleTree.of(mesh)
        self._T_object_palm = np.eye(4)
        self._joints = np.zeros(hand.n_joints)
        self._T_palm_link: Array | None = None
        self._placed = np.zeros(hand.n_links, dtype=np.bool_)

    @classmethod
    def of_part(
        cls,
        hand: HandDescription,
        part: Part,
        field: DistanceField | None = None,
        tree: TriangleTree | None = None,
    ) -> Self:
        """The world of a part; of a large one, with its simplified mesh.

        `tree` is that of the part's whole mesh.
        """
        whole = part.simplified is None
        return cls(hand, part.working_mesh, field, tree if whole else None)

    def __enter__(self) -> Self:
        self._context = bullet_client()
        self.client = self._context.__enter__()
        self._pieces = [
            [convex_body(self.client, piece) for piece in pieces]
            for pieces in self.hand.link_collision
        ]
        self._object = concave_bodies(self.client, self.mesh)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._context.__exit__(kind, value, trace)

    def place_palm(self, T_object_palm: Array) -> None:
        """Put the palm frame to a pose (4, 4) in the object's frame."""
        self._T_object_palm = np.array(T_object_palm, dtype=float)
        self._placed[:] = False

    def set_joints(self, joints: Array) -> None:
        """Set all joint angles (J,) [rad]."""
        self._joints = np.array(joints, dtype=float)
        self._T_palm_link = None
        self._placed[:] = False

    def set_joint(self, joint: int, angle: float) -> None:
        """Set one joint's angle [rad]."""
        joints = self._joints.copy()
        joints[joint] = angle
        self.set_joints(joints)

    def link_pose(self, link: int) -> Array:
        """Pose of a link's frame in the object's frame, (4, 4)."""
        if self._T_palm_link is None:
            self._T_palm_link = link_transforms(self.hand, self._joints)[0]
        return np.asarray(self._T_object_palm @ self._T_palm_link[link])

    def _bodies(self, link: int) -> list[int]:
        """The link's bodies, moved to where the link is."""
        if not self._placed[link]:
            position, quat_xyzw = to_position_quat_xyzw(self.link_pose(link))
            for body in self._pieces[link]:
                self.client.resetBasePositionAndOrientation(body, position, quat_xyzw)
            self._placed[link] = True
        return self._pieces[link]

    def _pairs(self, link: int, distance: float) -> list[Any]:
        return [
            row
            for body in self._bodies(link)
            for piece in self._object
            for row in self.client.getClosestPoints(body, piece, distance)
        ]

    def closest(self, link: int, distance: float) -> ClosestPoints:
        """One pair per triangle nearer than `distance` [m] to a link, tilted ones included.

        Some 10 us for each triangle whose box meets the link's.
        """
        found = self._pairs(link, distance)
        k = len(found)
        return ClosestPoints(
            on_link=np.array([row[5] for row in found]).reshape(k, 3),
            on_object=np.array([row[6] for row in found]).reshape(k, 3),
            normals_inward=-np.array([row[7] for row in found]).reshape(k, 3),
            distances=np.array([row[8] for row in found]),
        )

    def gap(self, link: int, limit: float) -> float:
        """Distance of a link from the object [m], at most `limit`; negative: depth."""
        nearest = min((row[8] for row in self._pairs(link, limit)), default=limit)
        if nearest >= 0.0:
            depth = self._depth_inside(link)
            if depth > 0.0:
                return -depth
        return float(min(nearest, limit))

    def hand_gap(self, limit: float, links: list[int] | None = None) -> float:
        """Smallest :meth:`gap` of all (or the given) links."""
        chosen = range(self.hand.n_links) if links is None else links
        return min(self.gap(link, limit) for link in chosen)

    def links_near(self, link: int, other: int, limit: float) -> bool:
        """Whether two links of the hand are nearer to each other than `limit` [m]."""
        return any(
            row[8] < limit
            for body in self._bodies(link)
            for partner in self._bodies(other)
            for row in self.client.getClosestPoints(body, partner, limit)
        )

    def penetration(self, link: int) -> float:
        """Depth of a link in the object [m], 0 where they are apart.

        The largest distance the link must move to come free of any one triangle, or the depth of
        its middle where it is wholly inside.
        """
        return max(0.0, -self.gap(link, 0.0))

    def contacts(self, link: int, threshold: float) -> ClosestPoints:
        """Pairs within `threshold` [m] that are contacts of the bodies, nearest first.

        A triangle beside the point of contact also has a nearest pair, but a tilted one: kept
        are pairs whose point on the link has no nearer point on the whole mesh.
        """
        found = self.closest(link, threshold)
        keep = [
            index
            for index in np.argsort(found.distances)
            if found.distances[index] > 0.0
            and self._is_nearest(found.on_link[index], float(found.distances[index]))
        ]
        return ClosestPoints(
            found.on_link[keep],
            found.on_object[keep],
            found.normals_inward[keep],
            found.distances[keep],
        )

    def _is_nearest(self, point: Array, distance: float) -> bool:
        tree = self.tree
        limit = _SAME_DISTANCE * distance + 1e-5
        x, y, z = point
        nearest, _, _ = nearest_point(
            x, y, z, limit, tree.triangles, tree.lower, tree.upper, tree.child, np.empty(3)
        )
        # PyBullet's points are good to some 1e-6 m
        return bool(nearest > distance / _SAME_DISTANCE - 2e-6)

    def _depth_inside(self, link: int) -> float:
        """Depth of the middles of the link's pieces; not positive where they are outside."""
        T = self.link_pose(link)
        middles = [piece.vertices.mean(axis=0) for piece in self.hand.link_collision[link]]
        return float(-self.field.value(apply(T, middles)).min())
