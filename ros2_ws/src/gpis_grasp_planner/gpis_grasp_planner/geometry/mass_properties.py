"""Volume and centre of mass of a closed surface, and of the convex hull of any."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from gpis_grasp_planner.geometry.mesh import TriangleMesh

Array = NDArray[np.float64]


def signed_volume(triangles: Array) -> float:
    """Volume [m^3] enclosed by triangles (m, 3, 3); negative if they face inwards."""
    return float(_tetrahedra(triangles).sum())


def volume_and_center(triangles: Array) -> tuple[float, Array]:
    """Signed volume [m^3] and centre of volume (3,) [m] of closed triangles (m, 3, 3).

    Tetrahedra between each face and the mean corner are summed, which keeps the precision of a
    part far from the origin. A surface without volume has its mean corner as centre.
    """
    origin = triangles.reshape(-1, 3).mean(axis=0)
    local = triangles - origin
    volumes = _tetrahedra(local)
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


def _tetrahedra(triangles: Array) -> Array:
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    return np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
