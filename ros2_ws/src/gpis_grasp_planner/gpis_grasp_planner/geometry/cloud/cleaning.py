"""A cloud made fit for a surface: too many points thinned, outliers taken out, noise measured."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.cloud.library import open3d

Array = NDArray[np.float64]
Index = NDArray[np.intp]

FEWEST_POINTS = 100
_MOST_POINTS = 30_000
_OUTLIER_NEIGHBOURS = 16
_OUTLIER_RATIO = 3.0  # mean distance to neighbours over the cloud's mean, in its deviations
_MOST_OUTLIERS = 0.5
_PATCHES = 400
_FIRST_NEIGHBOURS = 32
_MOST_NEIGHBOURS = 512
_REACH = 4.0  # radius of a neighbourhood over the noise: 3.7 at most where there is no surface
_REACH_OF_NORMALS = 3.0  # a normal's neighbourhood is as small as it may be, for small features
_QUANTILE = 0.3  # of the patches' residuals: those with an edge in them are the larger ones


def to_open3d(points: Array) -> Any:
    """Open3D's cloud of points (n, 3)."""
    o3d = open3d()
    cloud = o3d.geometry.PointCloud()
    cloud.points = o3d.utility.Vector3dVector(np.ascontiguousarray(points))
    return cloud


def thinned(points: Array) -> Index:
    """Indices of at most 30,000 points, evenly chosen; equal points count once."""
    _, first = np.unique(points, axis=0, return_index=True)
    first = np.sort(first)
    if len(first) <= _MOST_POINTS:
        return first
    chosen = np.random.default_rng(0).choice(len(first), _MOST_POINTS, replace=False)
    return first[np.sort(chosen)]


def inliers(points: Array, name: str) -> Index:
    """Indices of the points that are not outliers (Open3D's statistical removal).

    Raises
    ------
    MeshError
        MESH_DEGENERATE: too few points at the start or at the end.
    """
    check_count(len(points), name, "distinct points")
    _, kept = to_open3d(points).remove_statistical_outlier(_OUTLIER_NEIGHBOURS, _OUTLIER_RATIO)
    index = np.sort(np.asarray(kept, dtype=np.intp))
    if len(index) < (1.0 - _MOST_OUTLIERS) * len(points):
        raise MeshError(
            f"{name}: {len(points) - len(index)} of its {len(points)} points are outliers, more "
            "than half. Cut the part out of the scan, or filter the scan.",
            ErrorCode.MESH_DEGENERATE,
        )
    check_count(len(index), name, "points that are no outliers")
    return index


def check_count(n: int, name: str, what: str) -> None:
    """Refuse a cloud with too few points for a surface."""
    if n < FEWEST_POINTS:
        raise MeshError(
            f"{name} has {n} {what}; a surface takes at least {FEWEST_POINTS}. Scan more densely, "
            "or export a mesh.",
            ErrorCode.MESH_DEGENERATE,
        )


def noise_and_neighbours(points: Array, name: str) -> tuple[float, int]:
    """Standard deviation [m] of the points across the surface, and neighbours that show a plane.

    The residuals of quadrics ``z = a + b u + c v + d u^2 + e uv + f v^2`` in the local frame of
    neighbourhoods, ``s^2 = SSR / (k - 6)``; k doubles until a neighbourhood reaches four times
    as far as the noise. Of the patches the 30 % quantile counts, over that of the chi
    distribution: the rest may have an edge in them, or another wall.

    Raises
    ------
    MeshError
        MESH_DEGENERATE where the points scatter so far that there is no surface.
    """
    from scipy.spatial import cKDTree
    from scipy.stats import chi2

    tree = cKDTree(points)
    chosen = np.random.default_rng(0).choice(len(points), min(_PATCHES, len(points)), replace=False)
    k = first = min(_FIRST_NEIGHBOURS, len(points) // 4)
    while True:
        distance, near = tree.query(points[chosen], k=k)
        residual = _residuals(points[near])
        share = float(np.sqrt(chi2.ppf(_QUANTILE, k - 6) / (k - 6)))
        noise = float(np.quantile(residual, _QUANTILE)) / share
        reach = float(np.median(np.asarray(distance)[:, -1]))
        if reach >= _REACH * noise or 2 * k > min(_MOST_NEIGHBOURS, len(points) // 2):
            break
        if reach < _REACH_OF_NORMALS * noise:
            first = 2 * k
        k *= 2
    extent = float(np.ptp(points, axis=0).max())
    if reach < _REACH * noise:
        raise MeshError(
            f"{name}: its points scatter by {1e3 * noise:.2g} mm about any surface, for an extent "
            f"of {1e3 * extent:.3g} mm: none can be seen in neighbourhoods of {k} points, which "
            f"reach {1e3 * reach:.2g} mm. Filter the scan, or scan more densely.",
            ErrorCode.MESH_DEGENERATE,
        )
    return noise, first


def _residuals(groups: Array) -> Array:
    """Root mean square (g,) of what quadrics leave of point groups (g, k, 3)."""
    local = groups - groups.mean(axis=1, keepdims=True)
    _, _, axes = np.linalg.svd(local, full_matrices=False)
    u, v, z = np.moveaxis(local @ axes.transpose(0, 2, 1), 2, 0)
    scale = np.sqrt((u**2 + v**2).mean(axis=1, keepdims=True)) + 1e-12
    u, v = u / scale, v / scale
    A = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=2)
    Q, _ = np.linalg.qr(A)
    left = z - np.einsum("gkc,gc->gk", Q, np.einsum("gkc,gk->gc", Q, z))
    return np.sqrt((left**2).sum(axis=1) / (z.shape[1] - A.shape[2]))
