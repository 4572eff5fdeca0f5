"""What is believed of a cloud's unseen back before the cloud is asked: an ellipsoid.

For the surface point p with outward normal n of a body with centre c and half extents D along some
axes, ``p = c + D n`` is right for balls and, on average over its faces, for boxes. Points with
normals are therefore fitted by ``p = c + A n`` (least squares, A symmetric): the centre comes out
where a symmetric body has it, also where only one side was seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Half extents over half the seen extent along the same axis: what is believed of them.
_LEAST, _MOST = 0.35, 1.3
_STEP = 1e-4
# Weight of the belief that the body is as deep as it was seen, in points of full weight.
_RIDGE = 0.003


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """An ellipsoid: centre (3,), axes as columns (3, 3), half extents (3,)."""

    center: Array
    axes: Array
    half: Array

    @staticmethod
    def of(points: Array, normals_outward: Array) -> Ellipsoid:
        """The ellipsoid of points (n, 3) and normals (n, 3) that are spread evenly."""
        middle = 0.5 * (points.max(axis=0) + points.min(axis=0))
        _, axes = np.linalg.eigh(np.cov(points.T))
        seen = (points - middle) @ axes
        low, high = seen.min(axis=0), seen.max(axis=0)
        half_seen = np.maximum(0.5 * (high - low), 1e-9)
        n = normals_outward @ axes
        center, half = np.empty(3), np.empty(3)
        for t in range(3):
            # p = c + d n along one axis, with d drawn towards half of what was seen.
            spread = n[:, t] - n[:, t].mean()
            slope = spread @ (seen[:, t] - seen[:, t].mean()) / len(n) + _RIDGE * half_seen[t]
            half[t] = slope / (spread @ spread / len(n) + _RIDGE)
            half[t] = np.clip(half[t], _LEAST * half_seen[t], _MOST * half_seen.max())
            center[t] = seen[:, t].mean() - half[t] * n[:, t].mean()
        return Ellipsoid(middle + axes @ center, axes, half)

    def value(self, x: Array) -> Array:
        """About the signed distance (n,) of points (n, 3), positive outside."""
        y = (x - self.center) @ self.axes
        g = np.linalg.norm(y / self.half, axis=1)
        h = np.linalg.norm(y / self.half**2, axis=1)
        return np.where(g > 1e-6, g * (g - 1.0) / np.maximum(h, 1e-12), -self.half.min())

    def gradient(self, x: Array) -> Array:
        """Gradient (n, 3) of :meth:`value`, by central differences."""
        step = _STEP * self.half.max()
        return np.stack(
            [(self.value(x + s) - self.value(x - s)) / (2.0 * step) for s in step * np.eye(3)],
            axis=1,
        )
