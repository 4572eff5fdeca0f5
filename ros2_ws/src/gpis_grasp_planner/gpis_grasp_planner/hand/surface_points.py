"""Points with normals all over a hand's links, for evaluators that look distances up in a field.

A link touches an object where one of its surface points is at distance zero; how finely the
points lie decides what such an evaluator can miss. The side that grasps (around the desired
contacts' normals) is covered more finely than the rest; every hull vertex and sharp edge is in.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.hand.description import HandDescription

Array = NDArray[np.float64]

_SHARP_COSINE = np.cos(np.radians(20.0))
_CANDIDATE_SPACING = 0.0025  # of the dense cover the points are chosen from [m]
_MERGE_DISTANCE = 0.0008  # vertices and edge points nearer than this are one point [m]


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Surface points of all links, ordered by link; arrays are shared and read-only.

    Attributes
    ----------
    points : (n, 3) array [m]
        In the frame of the point's link.
    normals_outward : (n, 3) array
        Unit, out of the hand, in the same frame; the mean of the faces at vertices and edges.
    links : (n,) int array
    offsets : (L + 1,) int array
        Link l owns the rows ``offsets[l]:offsets[l + 1]``.
    """

    points: Array
    normals_outward: Array
    links: NDArray[np.int64]
    offsets: NDArray[np.int64]


@lru_cache(maxsize=16)
def surface_points(
    hand: HandDescription, fine_spacing: float | None = None, coarse_spacing: float = 0.012
) -> SurfacePoints:
    """Cover the links' surfaces with points.

    Parameters
    ----------
    hand : HandDescription
    fine_spacing, coarse_spacing : float [m]
        Largest distance of a place from its nearest point on the grasping side, and elsewhere. Fine
        is 5 mm, and half of that for a hand with flat pads, whose patch's corners are wanted.

    Returns
    -------
    SurfacePoints
        Some 100 to 300 per link; cached. The first call takes about 0.2 s.
    """
    if fine_spacing is None:
        fine_spacing = 0.0025 if hand.contact_patches else 0.005
    points, normals = [], []
    shapes: dict[tuple[object, ...], tuple[Array, Array]] = {}
    for link, pieces in enumerate(hand.link_collision):
        wanted = hand.desired_contacts.links == link
        grasping = (
            hand.desired_contacts.points[wanted],
            hand.desired_contacts.normals[wanted],
        )
        key = (*map(id, pieces), *(places.tobytes() for places in grasping))
        if key not in shapes:  # fingers share their meshes
            shapes[key] = _cover(pieces, grasping, fine_spacing, coarse_spacing)
        points.append(shapes[key][0])
        normals.append(shapes[key][1])
    counts = [len(p) for p in points]
    result = SurfacePoints(
        points=np.vstack(points),
        normals_outward=np.vstack(normals),
        links=np.repeat(np.arange(len(counts)), counts),
        offsets=np.concatenate([[0], np.cumsum(counts)]),
    )
    for array in vars(result).values():
        array.setflags(write=False)
    return result


def _cover(
    pieces: tuple[TriangleMesh, ...], grasping: tuple[Array, Array], fine: float, coarse: float
) -> tuple[Array, Array]:
    points, normals, mandatory, spacing = [], [], [], []
    wanted_points, wanted_normals = grasping
    for index, piece in enumerate(pieces):
        feature = _features(piece, fine)
        area = _scatter(piece)
        p, n = (np.vstack(pair) for pair in zip(feature, area, strict=True))
        outside = np.ones(len(p), dtype=bool)
        for other_index, other in enumerate(pieces):
            if other_index != index:
                outside &= _height_over(other, p) > 1e-6
        points.append(p[outside])
        normals.append(n[outside])
        spacing.append(np.full(outside.sum(), coarse))
        if len(wanted_points) and _height_over(piece, wanted_points).min() < 1e-3:
            direction = _unit(wanted_normals.sum(axis=0, keepdims=True))[0]
            spacing[-1][n[outside] @ direction > 0.2] = fine
        mandatory.append((np.arange(len(p)) < len(feature[0]))[outside])
    p, n = np.vstack(points), np.vstack(normals)
    chosen = _choose(p, np.concatenate(spacing), np.concatenate(mandatory))
    return p[chosen], n[chosen]


def _choose(points: Array, spacing: Array, mandatory: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Mandatory points first (thinned where they coincide), then the farthest until covered."""
    nearest = np.full(len(points), np.inf)
    chosen: list[int] = []

    def add(index: int) -> None:
        chosen.append(index)
        distance = np.linalg.norm(points - points[index], axis=1)
        np.minimum(nearest, distance, out=nearest)

    for index in np.flatnonzero(mandatory):
        if nearest[index] > _MERGE_DISTANCE:
            add(int(index))
    worst = int(np.argmax(nearest / spacing))
    while nearest[worst] > spacing[worst]:
        add(worst)
        worst = int(np.argmax(nearest / spacing))
    return np.array(chosen)


def _features(mesh: TriangleMesh, spacing: float) -> tuple[Array, Array]:
    """Vertices, then points along sharp edges, with mean normals."""
    edges, cosine, edge_normal = _edges(mesh)
    vertex_normal = np.zeros_like(mesh.vertices)
    for corner in range(3):
        weight = mesh.face_normals_outward * mesh.face_areas[:, None]
        np.add.at(vertex_normal, mesh.faces[:, corner], weight)
    points, normals = [mesh.vertices], [_unit(vertex_normal)]
    for (a, b), normal in zip(
        edges[cosine < _SHARP_COSINE], edge_normal[cosine < _SHARP_COSINE], strict=True
    ):
        start, end = mesh.vertices[a], mesh.vertices[b]
        count = int(np.linalg.norm(end - start) / (2.0 * spacing))
        if count:
            share = np.arange(1, count + 1)[:, None] / (count + 1)
            points.append(start + share * (end - start))
            normals.append(np.tile(normal, (count, 1)))
    return np.vstack(points), np.vstack(normals)


def _edges(mesh: TriangleMesh) -> tuple[NDArray[np.int64], Array, Array]:
    """Edges (e, 2) of a closed mesh, cosine between their two faces and the mean normal."""
    half = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    order = np.lexsort((half[:, 1], half[:, 0]))
    pairs = order.reshape(-1, 2) // 3  # a closed mesh has each edge twice
    first, second = (mesh.face_normals_outward[pairs[:, side]] for side in (0, 1))
    cosine = np.einsum("ij,ij->i", first, second)
    return half[order[::2]].astype(np.int64), cosine, _unit(first + second)


def _scatter(mesh: TriangleMesh) -> tuple[Array, Array]:
    """Points spread evenly over the faces by area, with their faces' normals; no randomness."""
    cumulative = np.cumsum(mesh.face_areas)
    n = int(np.ceil(2.0 * cumulative[-1] / _CANDIDATE_SPACING**2))
    faces = np.searchsorted(cumulative, (np.arange(n) + 0.5) / n * cumulative[-1])
    # The plastic number's additive recurrence: the plane's counterpart of the golden ratio.
    u, v = (np.outer((0.7548776662466927, 0.5698402909980532), np.arange(n)) + 0.5) % 1.0
    fold = u + v > 1.0
    u, v = np.where(fold, 1.0 - u, u), np.where(fold, 1.0 - v, v)
    barycentric = np.column_stack([1.0 - u - v, u, v])
    points = np.einsum("nc,nci->ni", barycentric, mesh.triangles[faces])
    return points, mesh.face_normals_outward[faces]


def _height_over(convex: TriangleMesh, points: Array) -> Array:
    """Largest distance over the face planes: positive outside a convex piece."""
    normal = convex.face_normals_outward
    offset = np.einsum("ij,ij->i", normal, convex.triangles[:, 0])
    return np.asarray((points @ normal.T - offset).max(axis=1))


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
