"""What a Gaussian process is told of a cloud: few points, each the mean of its neighbourhood."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.cloud.process import Observations

Array = NDArray[np.float64]

_ALIKE = 0.7  # cosine between normals of one neighbourhood: opposite walls stay apart
_NORMAL_WEIGHT = 0.5
_LEAST_NOISE = 0.02  # of the samples' spacing: a mean over a curved neighbourhood is not exact
_NORMAL_NOISE = 0.2


def farthest_points(points: Array, normals: Array, count: int) -> NDArray[np.intp]:
    """Indices of points spread evenly over both sides of every wall.

    The farthest of all from those chosen before, by distance and direction of the normal together.
    """
    spacing = float(np.linalg.norm(np.ptp(points, axis=0))) / np.sqrt(count)
    features = np.concatenate([points, _NORMAL_WEIGHT * spacing * normals], axis=1)
    nearest = np.full(len(features), np.inf)
    chosen = np.zeros(min(count, len(points)), dtype=np.intp)
    for i in range(1, len(chosen)):
        offset = features - features[chosen[i - 1]]
        np.minimum(nearest, np.einsum("ij,ij->i", offset, offset), out=nearest)
        chosen[i] = nearest.argmax()
    return chosen


def observations(points: Array, normals: Array, noise: float, count: int) -> Observations:
    """Samples of a cloud (n, 3) with outward normals (n, 3) and noise [m].

    A sample is moved along its normal to the mean height of the points about it with like
    normals, out to half the samples' spacing; its noise is that of the mean.
    """
    from scipy.spatial import cKDTree

    chosen = farthest_points(points, normals, count)
    apart, _ = cKDTree(points[chosen]).query(points[chosen], k=2)
    spacing = float(np.median(np.asarray(apart)[:, 1]))
    tree = cKDTree(points)
    out, directions, deviation = np.empty((3, len(chosen), 3))
    for row, (i, members) in enumerate(
        zip(chosen, tree.query_ball_point(points[chosen], 0.6 * spacing), strict=True)
    ):
        near = np.array(members, dtype=np.intp)
        near = near[normals[near] @ normals[i] > _ALIKE]
        mean = normals[near].sum(axis=0)
        directions[row] = mean / np.linalg.norm(mean)
        height = (points[near] - points[i]) @ directions[row]
        out[row] = points[i] + height.mean() * directions[row]
        deviation[row] = noise / np.sqrt(len(near))
    return Observations(
        out, directions, np.hypot(deviation[:, 0], _LEAST_NOISE * spacing), _NORMAL_NOISE
    )
