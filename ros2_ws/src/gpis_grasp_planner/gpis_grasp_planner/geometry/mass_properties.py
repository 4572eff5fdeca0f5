"""Volume and centre of mass of a closed surface, its holes closed by fans, or its convex hull."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.topology import Edges

Array = NDArray[np.float64]


def signed_volume(triangles: Array) -> float:
    """Volume [m^3] enclosed by triangles (m, 3, 3); negative if they face inwards."""
    return float(tetrahedra(triangles).sum())


def volume_and_center(triangles: Array) -> tuple[float, Array]:
    """Signed volume [m^3] and centre of volume (3,) [m] of closed triangles (m, 3, 3).

    Tetrahedra between each face and the mean corner are summed, which keeps the precision of a
    part far from the origin. A surface without volume has its mean corner as centre.
    """
    origin = triangles.reshape(-1, 3).mean(axis=0)
    local = triangles - origin
    volumes = tetrahedra(local)
    total = float(volumes.sum())
    if total == 0.0:
        return 0.0, origin
    return total, origin + (volumes[:, None] * local.sum(axis=1)).sum(axis=0) / (4.0 * total)


def hull(mesh: TriangleMesh) -> TriangleMesh:
    """Convex hull of the vertices, facing outwards. Raises scipy's QhullError if they are flat."""
    found = ConvexHull(mesh.vertices)
    faces = found.simplices.astype(np.int32)
    triangles = mesh.vertices[faces]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    inward = np.einsum("ij,ij->i", normals, found.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return TriangleMesh(mesh.vertices, faces)


def fans_across_holes(vertices: Array, edges: Edges) -> Array:
    """Triangles (k, 3, 3) that close a surface: a fan from each hole's mean corner to its rim.

    A flat hole is closed exactly, whatever its shape. Edges where the surface ends, connected by
    their vertices, make one hole; the fans wind with the faces.
    """
    rim = edges.balance != 0
    if not rim.any():
        return np.zeros((0, 3, 3))
    ends, balance = edges.ends[rim], edges.balance[rim]
    ends = np.where((balance > 0)[:, None], ends[:, ::-1], ends)  # against the face's direction
    ends = np.repeat(ends, np.abs(balance), axis=0)
    corners, index = np.unique(ends, return_inverse=True)
    index = index.reshape(ends.shape)
    graph = coo_matrix(
        (np.ones(len(index), dtype=np.int8), (index[:, 0], index[:, 1])),
        shape=(len(corners), len(corners)),
    )
    count, hole = connected_components(graph, directed=False)
    members = np.bincount(hole, minlength=count)
    middles = np.stack(
        [np.bincount(hole, vertices[corners, d], minlength=count) / members for d in range(3)],
        axis=1,
    )
    return np.stack(
        [vertices[ends[:, 0]], vertices[ends[:, 1]], middles[hole[index[:, 0]]]], axis=1
    )


def tetrahedra(triangles: Array) -> Array:
    """Signed volumes (m,) [m^3] of the tetrahedra between triangles (m, 3, 3) and the origin."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    return np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
