"""A concave solid as overlapping convex pieces, for a dynamics engine that moves only those.

The usual approximate decompositions cut the volume and let the pieces' hulls bulge over the
surface by millimetres. Here the surface is covered instead: from a triangle a piece grows over
its neighbours as long as every vertex sees every other one through the solid (no segment leaves
it by more than a tolerance), and its hull becomes the piece. Every triangle lies in some piece,
so that no contact is late, and pieces stand out of the solid by the tolerance at most where
segments tell, so that none is early. Pieces may overlap, and the inside may stay hollow; neither
matters to contacts. The idea of mutual visibility is that of weakly convex decomposition (Asafi,
Goren and Cohen-Or, 2013).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.geometry.distance_field import DistanceField, field_value
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree, nearest_point

Array = NDArray[np.float64]

_CHECKED_MEMBERS = 24
_THICKNESSES_M = (0.006, 0.003, 0.0015, 0.0008)
_MAX_VERTICES = 420
# barycentric coordinates of samples on a triangle
_LATTICE = np.array(
    [(i, j, 6 - i - j) for i in range(7) for j in range(7 - i) if max(i, j, 6 - i - j) < 6]
)
_LATTICE = _LATTICE / 6.0


class Piece(NamedTuple):
    """A convex piece: vertices (n, 3) [m] of its hull, and the faces (k,) that it covers."""

    points: Array
    faces: NDArray[np.int64]


class _Solid(NamedTuple):
    """Distance field and triangle tree of a mesh, as the compiled functions take them."""

    values: NDArray[np.float32]
    origin: Array
    spacing: float
    triangles: Array
    lower: Array
    upper: Array
    child: NDArray[np.int64]


class ConvexCover:
    """Convex pieces over a mesh's surface, made where they are asked for.

    Pieces that are made stay as they are. What a piece costs depends on its neighbourhood alone,
    so that a patch of a mesh of a million triangles is covered as fast as one of ten thousand.

    Parameters
    ----------
    mesh : TriangleMesh
    field, tree : DistanceField, TriangleTree
        Of the same mesh.
    tolerance : float [m]
        How far a segment between two points of a piece may leave the solid.

    Attributes
    ----------
    pieces : list of (n, 3) arrays [m]
        Vertices of the pieces' hulls.
    """

    def __init__(
        self, mesh: TriangleMesh, field: DistanceField, tree: TriangleTree, tolerance: float = 2e-4
    ):
        self.pieces: list[Array] = []
        self._faces_of: list[NDArray[np.int64]] = []
        self._solid_faces = mesh.face_areas > 1e-12
        self._vertices = np.ascontiguousarray(mesh.vertices, dtype=float)
        self._faces = np.ascontiguousarray(mesh.faces[self._solid_faces], dtype=np.int64)
        self._areas = mesh.face_areas[self._solid_faces]
        self._normals = mesh.face_normals_outward[self._solid_faces]
        self._start, self._around = _faces_around_vertices(self._faces, len(self._vertices))
        self._covered = np.zeros(len(self._faces), dtype=np.bool_)
        # Marks of the piece that grows: a new number makes all of an earlier one's void.
        self._queued = np.full(len(self._faces), -1, dtype=np.int64)
        self._member = np.full(len(self._vertices), -1, dtype=np.int64)
        self._refused = np.full(len(self._vertices), -1, dtype=np.int64)
        self._number = 0
        self._tolerance = tolerance
        self._last = 64
        self._solid = _Solid(
            field.values, field.origin, field.spacing,
            tree.triangles, tree.lower, tree.upper, tree.child,
        )  # fmt: skip

    def is_complete(self) -> bool:
        """Whether the whole surface is covered."""
        return bool(self._covered.all())

    def covers(self, faces: NDArray[np.bool_]) -> bool:
        """Whether some faces of the mesh (m,) are all covered."""
        return bool(self._covered[faces[self._solid_faces]].all())

    def add(
        self,
        faces: NDArray[np.bool_] | None = None,
        go_on: Callable[[], bool] = lambda: True,
    ) -> bool:
        """Cover some faces of the mesh (m,), or all; the largest first.

        Parameters
        ----------
        faces : (m,) bool array, optional
        go_on : callable
            Asked before each piece; where it says no, the rest is left uncovered.

        Returns
        -------
        bool
            Whether pieces were added. Some 0.3 ms for each triangle not covered before.
        """
        wanted = ~self._covered
        if faces is not None:
            wanted &= faces[self._solid_faces]
        seeds = np.flatnonzero(wanted)
        before = len(self.pieces)
        for seed in seeds[np.argsort(-self._areas[seeds], kind="stable")]:
            if self._covered[seed]:
                continue
            if not go_on():
                break
            self._cover(int(seed))
        return len(self.pieces) > before

    @property
    def n_covered(self) -> int:
        """Faces of some area that are covered."""
        return int(self._covered.sum())

    def since(self, n_pieces: int) -> list[Piece]:
        """The pieces made after the first `n_pieces`, for :meth:`take` of another process."""
        return [
            Piece(points, faces)
            for points, faces in zip(self.pieces[n_pieces:], self._faces_of[n_pieces:], strict=True)
        ]

    def take(self, pieces: Sequence[Piece]) -> None:
        """Take over what another process made of the same mesh.

        A piece of which less than half is new is left: pieces that overlap cost contacts twice.
        """
        for points, faces in pieces:
            if 2 * int((~self._covered[faces]).sum()) > len(faces):
                self._add(points, faces)

    def as_arrays(self) -> dict[str, NDArray[Any]]:
        """What there is of the cover as arrays, for :meth:`take_arrays`."""
        return {
            "points": np.concatenate(self.pieces or [np.empty((0, 3))]),
            "ends": np.cumsum([len(piece) for piece in self.pieces], dtype=np.int64),
            "faces": np.concatenate(self._faces_of or [np.empty(0, dtype=np.int64)]),
            "face_ends": np.cumsum([len(faces) for faces in self._faces_of], dtype=np.int64),
            "covered": self._covered,
        }

    def take_arrays(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take a cover of the same mesh and tolerance, made before, in place of what there is."""
        if not len(arrays["ends"]):
            return
        self.pieces = np.split(arrays["points"], arrays["ends"][:-1])
        self._faces_of = np.split(arrays["faces"], arrays["face_ends"][:-1])
        self._covered[:] = arrays["covered"]

    def _add(self, points: Array, faces: NDArray[np.int64]) -> None:
        self.pieces.append(points)
        self._faces_of.append(faces)
        self._covered[faces] = True

    def _cover(self, seed: int) -> None:
        """Grow a piece from a face and mark what lies in it."""
        vertices, faces = self._vertices, self._faces
        limit = min(2 * self._last, _MAX_VERTICES)
        piece = None
        while piece is None:
            self._number += 1
            members, taken = _grow(
                seed, vertices, faces, self._start, self._around, self._solid, self._tolerance,
                limit, self._queued, self._member, self._refused, self._number,
            )  # fmt: skip
            taken = taken[~self._covered[taken]]
            points = vertices[np.unique(faces[taken])]
            inner = _inner_points(
                points, vertices, faces[taken], self._normals[taken], self._solid, self._tolerance
            )
            piece = _hull(np.concatenate([points, inner]), self._solid, self._tolerance)
            if piece is None and limit <= 3:
                break
            limit = max(3, min(limit, len(members)) // 3)
        self._covered[taken] = True
        self._covered[seed] = True
        self._last = max(len(members), 8)
        if piece is not None:
            self._add(piece, taken)


def convex_cover(
    mesh: TriangleMesh, field: DistanceField, tree: TriangleTree, tolerance: float = 2e-4
) -> list[Array]:
    """Cover the whole of a mesh's surface by convex pieces; see :class:`ConvexCover`."""
    cover = ConvexCover(mesh, field, tree, tolerance)
    cover.add()
    return cover.pieces


def _inner_points(
    points: Array,
    vertices: Array,
    faces: NDArray[np.int64],
    normals: Array,
    solid: _Solid,
    tolerance: float,
) -> Array:
    """Points below the piece's triangles that give a flat piece its thickness, (n, 3)."""
    middles = vertices[faces].mean(axis=1)
    if len(middles) > 12:
        chosen = np.linspace(0, len(middles) - 1, 12).astype(int)
        middles, normals = middles[chosen], normals[chosen]
    found: list[Array] = []
    for middle, normal in zip(middles, normals, strict=True):
        for thickness in _THICKNESSES_M:
            p = middle - thickness * normal
            ends = np.array([*points[:: max(1, len(points) // _CHECKED_MEMBERS)], *found])
            if _is_inside(solid, p, ends, tolerance):
                found.append(p)
                break
    return np.array(found).reshape(-1, 3)


def _hull(points: Array, solid: _Solid, tolerance: float) -> Array | None:
    """Vertices of the hull; None where it is flat or stands out of the solid."""
    if len(points) < 4 or np.linalg.matrix_rank(points - points.mean(axis=0), tol=1e-5) < 3:
        return None
    hull = ConvexHull(points, qhull_options="QJ")
    samples = np.einsum("sc,fcd->fsd", _LATTICE, points[hull.simplices]).reshape(-1, 3)
    if not _all_inside(solid, samples, tolerance):
        return None
    return points[_extreme(points, hull.vertices)]


def _extreme(points: Array, corners: NDArray[np.int32]) -> NDArray[np.int32]:
    """The corners, or of very many only those extreme in one of evenly spread directions."""
    if len(corners) <= _MAX_VERTICES:
        return corners
    i = np.arange(_MAX_VERTICES) + 0.5
    polar, azimuth = np.arccos(1 - 2 * i / _MAX_VERTICES), np.pi * (1 + 5**0.5) * i
    directions = np.stack(
        [np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)]
    )
    return corners[np.unique(np.argmax(points[corners] @ directions, axis=0))]


def _faces_around_vertices(
    faces: NDArray[np.int64], n_vertices: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Faces at vertex v are ``around[start[v]:start[v + 1]]``."""
    flat = faces.ravel()
    order = np.argsort(flat, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(flat, minlength=n_vertices))])
    return start.astype(np.int64), (order // 3).astype(np.int64)


@njit
def _holds(solid, x, y, z, d, tolerance, q):  # type: ignore[no-untyped-def]
    """Whether a point whose field value is `d` is at most the tolerance outside."""
    if d <= tolerance:
        return True
    if d > tolerance + solid.spacing:
        return False
    # the field rounds edges off; the mesh decides
    _, face, _ = nearest_point(
        x, y, z, tolerance, solid.triangles, solid.lower, solid.upper, solid.child, q
    )
    return face >= 0


@njit
def _all_inside(solid, points, tolerance):  # type: ignore[no-untyped-def]
    q = np.empty(3)
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        d = field_value(solid.values, solid.origin, solid.spacing, x, y, z)
        if not _holds(solid, x, y, z, d, tolerance, q):
            return False
    return True


@njit
def _sees(solid, a, b, tolerance):  # type: ignore[no-untyped-def]
    """Whether the segment between two points leaves the solid by at most the tolerance."""
    dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    q = np.empty(3)
    s = 0.25 * solid.spacing
    while s < length:
        u = s / length
        x, y, z = a[0] + u * dx, a[1] + u * dy, a[2] + u * dz
        d = field_value(solid.values, solid.origin, solid.spacing, x, y, z)
        if not _holds(solid, x, y, z, d, tolerance, q):
            return False
        # deep inside, the distance says how far the segment surely stays inside
        s += max(0.5 * solid.spacing, -0.9 * d)
    return True


@njit
def _is_inside(solid, p, ends, tolerance):  # type: ignore[no-untyped-def]
    """Whether a point is inside and sees all `ends` (n, 3)."""
    if field_value(solid.values, solid.origin, solid.spacing, p[0], p[1], p[2]) > 0.0:
        return False
    # numba takes no generator expression here
    for i in range(ends.shape[0]):  # noqa: SIM110
        if not _sees(solid, p, ends[i], tolerance):
            return False
    return True


@njit
def _sees_members(vertex, members, vertices, solid, tolerance):  # type: ignore[no-untyped-def]
    """Whether a vertex sees the members: the newest, and an even choice of the others."""
    n = members.shape[0]
    stride = max(1, n // _CHECKED_MEMBERS)
    for back in range(0, n, stride):
        if not _sees(solid, vertices[vertex], vertices[members[n - 1 - back]], tolerance):
            return False
    return True


@njit
def _grow(  # type: ignore[no-untyped-def]
    seed, vertices, faces, start, around, solid, tolerance, limit, queued, member, refused, number
):
    """Grow a piece from a face; returns its vertices and all faces that lie in it, in order.

    `queued` (m,), `member` and `refused` (v,) hold the number of the piece that marked them last.
    """
    members = np.empty(limit + 3, dtype=np.int64)
    queue = np.empty(64, dtype=np.int64)
    n_members = 0
    head, tail = 0, 1
    queue[0] = seed
    queued[seed] = number
    while head < tail and n_members + 3 <= max(limit, 3):
        face = queue[head]
        head += 1
        fits = True
        for v in faces[face]:
            if member[v] == number:
                continue
            if refused[v] != number and face != seed:
                seen = _sees_members(v, members[:n_members], vertices, solid, tolerance)
                refused[v] = refused[v] if seen else number
            if refused[v] == number:
                fits = False
                break
            member[v] = number
            members[n_members] = v
            n_members += 1
        if not fits:
            continue
        for v in faces[face]:
            for neighbour in around[start[v] : start[v + 1]]:
                if queued[neighbour] != number:
                    queued[neighbour] = number
                    if tail == queue.shape[0]:
                        longer = np.empty(2 * tail, dtype=np.int64)
                        longer[:tail] = queue
                        queue = longer
                    queue[tail] = neighbour
                    tail += 1
    return members[:n_members].copy(), _faces_within(queue[:tail], faces, member, number)


@njit
def _faces_within(queue, faces, member, number):  # type: ignore[no-untyped-def]
    """Faces of the queue all of whose vertices are members, in order."""
    taken = np.empty(queue.shape[0], dtype=np.int64)
    n = 0
    for face in queue:
        a, b, c = faces[face]
        if member[a] == number and member[b] == number and member[c] == number:
            taken[n] = face
            n += 1
    return np.sort(taken[:n])
