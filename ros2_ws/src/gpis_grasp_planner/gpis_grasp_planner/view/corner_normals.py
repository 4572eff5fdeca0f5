"""Normals that make round bodies look round and keep edges sharp."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from gpis_grasp_planner.geometry.mesh import TriangleMesh

Array = NDArray[np.float64]

_CREASE_COSINE = np.cos(np.radians(32.0))


def corner_normals(mesh: TriangleMesh) -> Array:
    """Normals (m, 3, 3) at the faces' corners: mean of the neighbours within the crease angle.

    A corner averages those faces around its vertex whose normals lie within 32 deg of its own
    face's, weighted by area, so that round bodies look round and edges stay sharp.
    """
    # Corners at the same place belong together, however the file split its vertices.
    _, vertex = np.unique(mesh.vertices.round(7), axis=0, return_inverse=True)
    corner_vertex = vertex.reshape(-1)[mesh.faces].reshape(-1)
    n_corners, n_vertices = len(corner_vertex), int(corner_vertex.max()) + 1
    at_vertex = csr_array(
        (np.ones(n_corners), (np.arange(n_corners), corner_vertex)), shape=(n_corners, n_vertices)
    )
    corner, other = (at_vertex @ at_vertex.T).nonzero()
    unit, area = mesh.face_normals_outward, mesh.face_areas
    cosine = np.einsum("ij,ij->i", unit[corner // 3], unit[other // 3])
    corner, other = corner[cosine > _CREASE_COSINE], other[cosine > _CREASE_COSINE]
    total = np.zeros((n_corners, 3))
    np.add.at(total, corner, unit[other // 3] * area[other // 3, None])
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray((total / np.maximum(length, 1e-12)).reshape(-1, 3, 3))
