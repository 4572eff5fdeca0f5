"""Evenly spread samples with normals on a triangle mesh (Poisson disks by dart throwing)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.surface_samples import uniform_samples

Array = NDArray[np.float64]

# Random disks of diameter s fill 54.7 % of a plane before no further one fits; eight candidates a
# sample reach four fifths of that. So n disks need s = sqrt(4 / pi * filling * area / n).
_FILLING = 0.8 * 0.547
_CANDIDATES_PER_SAMPLE = 8
_OPPOSED = -0.5
_CELLS_PER_AXIS = 128


def sample_surface(mesh: TriangleMesh, n: int, seed: int) -> tuple[Array, Array]:
    """About `n` evenly spread samples of the surface and their outward unit normals.

    Thousands of samples at the cost of a few microseconds each; `geometry.surface_samples` has a
    farthest-point sampler for some hundreds. Samples of one side of a wall keep their distance
    from each other, not from those of the other side.

    Parameters
    ----------
    mesh : TriangleMesh
    n : int
        Number aimed at; what comes differs by a few per cent.
    seed : int
        Equal seeds give equal samples.

    Returns
    -------
    points : (m, 3) array [m]
    normals_outward : (m, 3) array

    Raises
    ------
    MeshError
        Code MESH_DEGENERATE for a mesh without area.
    """
    area = float(mesh.face_areas.sum())
    if not area > 0.0 or not math.isfinite(area):
        raise MeshError(
            f"The mesh has a surface of {area} m^2; a positive one is needed to sample it. "
            "Check that its faces are not degenerate.",
            ErrorCode.MESH_DEGENERATE,
        )
    candidates = uniform_samples(mesh, _CANDIDATES_PER_SAMPLE * n, seed)
    spacing = math.sqrt(4.0 * _FILLING / math.pi * area / n)
    cell = max(spacing, float(mesh.extent.max()) / _CELLS_PER_AXIS)
    keep = _throw_darts(candidates.points, candidates.normals_outward, spacing, cell)
    return candidates.points[keep], candidates.normals_outward[keep]


@njit
def _throw_darts(p: Array, normal: Array, spacing: float, cell: float) -> NDArray[np.bool_]:
    """Keep, in the given order, points with no kept one nearer than the spacing.

    Only kept points whose normal is not opposed count as near. `cell` >= `spacing`; kept
    points hang in linked lists, one a cell.
    """
    n = p.shape[0]
    low = np.empty(3)
    size = np.empty(3, dtype=np.int64)
    for t in range(3):
        low[t] = p[:, t].min()
        size[t] = int((p[:, t].max() - low[t]) / cell) + 1
    head = np.full((size[0] + 2, size[1] + 2, size[2] + 2), -1, dtype=np.int64)
    following = np.full(n, -1, dtype=np.int64)
    keep = np.zeros(n, dtype=np.bool_)
    for i in range(n):
        x = int((p[i, 0] - low[0]) / cell) + 1
        y = int((p[i, 1] - low[1]) / cell) + 1
        z = int((p[i, 2] - low[2]) / cell) + 1
        free = True
        for k in range(27):
            if not free:
                break
            j = head[x - 1 + k // 9, y - 1 + k // 3 % 3, z - 1 + k % 3]
            while j >= 0 and free:
                r2 = 0.0
                cosine = 0.0
                for t in range(3):
                    r2 += (p[i, t] - p[j, t]) ** 2
                    cosine += normal[i, t] * normal[j, t]
                free = r2 >= spacing * spacing or cosine <= _OPPOSED
                j = following[j]
        if free:
            following[i] = head[x, y, z]
            head[x, y, z] = i
            keep[i] = True
    return keep
