"""What viewpoints tell of a cloud: which points each of them saw, and what must be empty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_NEIGHBOURS = 16  # looked at on a ray: those of the nearer wall must be among them
_SIDE = 1.5  # of a ray's width to either side, in the points' spacing
_DEPTH = 3.0  # tolerance of depths, in the noise and in the spacing
_MOST_CARVING = 6  # viewpoints that carve: a few that are far apart say nearly all


@dataclass(frozen=True, eq=False)
class View:
    """A cloud seen from one viewpoint: directions and depths of its points.

    Attributes
    ----------
    viewpoint : (3,) array [m]
    depth : (n,) array [m]
    width : float [rad]
        Half of a ray's width.
    tolerance : float [m]
        Of depths.
    """

    viewpoint: Array
    depth: Array
    width: float
    tolerance: float
    tree: Any

    @staticmethod
    def of(points: Array, viewpoint: Array, spacing: float, noise: float) -> View:
        """Of points (n, 3) with a spacing and a noise [m]."""
        from scipy.spatial import cKDTree

        way = points - viewpoint
        depth = np.linalg.norm(way, axis=1)
        return View(
            viewpoint,
            depth,
            (_SIDE * spacing + noise) / float(np.median(depth)),
            _DEPTH * max(noise, spacing),
            cKDTree(way / depth[:, None]),
        )

    def _first(self, points: Array) -> tuple[Array, Array, Array]:
        """Depth of points (m, 3), the least depth of the cloud on their rays, and how far off.

        The least depth is infinite on a ray that meets nothing; the third array is the angle [rad]
        to the nearest point of the cloud.
        """
        way = points - self.viewpoint
        depth = np.linalg.norm(way, axis=1)
        angle, near = self.tree.query(way / depth[:, None], k=_NEIGHBOURS)
        least = np.where(angle <= self.width, self.depth[near], np.inf).min(axis=1)
        return depth, least, angle[:, 0]

    def sees(self, points: Array, behind: float = 0.0) -> NDArray[np.bool_]:
        """Which points (m, 3) of the cloud have nothing before them (m,).

        By more than the tolerance, or by that share of the cloud's depth where it is more.
        """
        depth, least, _ = self._first(points)
        return depth <= least + max(self.tolerance, behind * float(np.ptp(self.depth)))

    def emptiness(self, points: Array) -> Array:
        """At least how far points (m, 3) are outside the body [m]; negative: nothing is known.

        Before what was seen, and beside the silhouette, where the ray met nothing at all: the cloud
        must be all that was seen of the part.
        """
        depth, least, angle = self._first(points)
        beside = (angle - self.width) * depth
        return np.where(np.isfinite(least), least - depth - self.tolerance, beside)


def spread(viewpoints: Array) -> Array:
    """At most six of the viewpoints (k, 3), far from each other."""
    chosen = [0]
    while len(chosen) < min(_MOST_CARVING, len(viewpoints)):
        off = np.linalg.norm(viewpoints[:, None] - viewpoints[chosen], axis=2).min(axis=1)
        chosen.append(int(off.argmax()))
    return viewpoints[chosen]


def spacing_of(points: Array) -> float:
    """Median distance [m] of points to their fourth neighbour over two: about their spacing."""
    from scipy.spatial import cKDTree

    distance, _ = cKDTree(points).query(points, k=5)
    return float(np.median(np.asarray(distance)[:, 4])) / np.sqrt(2.0)
