"""What viewpoints tell of a cloud: which points each of them saw, and what must be empty."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_NEIGHBOURS = 16  # looked at on a ray: those of the nearer wall must be among them
_SIDE = 1.5  # of a ray's width to either side, in the points' spacing
_DEPTH = 3.0  # tolerance of depths, in the noise and in the spacing
MOST_CARVING = 6  # viewpoints that carve: a few that are far apart say nearly all
MOST_ORIENTING = 12  # viewpoints that decide the sides of normals


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

    @cached_property
    def _least(self) -> Array:
        """The least depth of the cloud on the rays of its own points (n,) [m]."""
        return self._met(self.tree.data)[0]

    def _met(self, directions: Array) -> tuple[Array, Array]:
        """Least depth on rays (m, 3), infinite where they meet nothing; angle to the nearest."""
        angle, near = self.tree.query(directions, k=_NEIGHBOURS)
        least = np.where(angle <= self.width, self.depth[near], np.inf).min(axis=1)
        return np.asarray(least), angle[:, 0]

    def sees(self, behind: float = 0.0) -> NDArray[np.bool_]:
        """Which points of the cloud have nothing before them (n,).

        By more than the tolerance, or by that share of the cloud's depth where it is more.
        """
        return self.depth <= self._least + max(self.tolerance, behind * float(np.ptp(self.depth)))

    def emptiness(self, points: Array) -> Array:
        """At least how far points (m, 3) are outside the body [m]; negative: nothing is known.

        Before what was seen, and beside the silhouette, where the ray met nothing at all: the cloud
        must be all that was seen of the part.
        """
        way = points - self.viewpoint
        depth = np.linalg.norm(way, axis=1)
        least, angle = self._met(way / depth[:, None])
        beside = (angle - self.width) * depth
        return np.where(np.isfinite(least), least - depth - self.tolerance, beside)


def spread(viewpoints: Array, most: int) -> Array:
    """At most so many of the viewpoints (k, 3), far from each other."""
    chosen = [0][: min(most, len(viewpoints))]
    while len(chosen) < min(most, len(viewpoints)):
        off = np.linalg.norm(viewpoints[:, None] - viewpoints[chosen], axis=2).min(axis=1)
        chosen.append(int(off.argmax()))
    return viewpoints[chosen]


def spacing_of(points: Array) -> float:
    """Median distance [m] of points to their fourth neighbour over two: about their spacing."""
    from scipy.spatial import cKDTree

    distance, _ = cKDTree(points).query(points, k=5)
    return float(np.median(np.asarray(distance)[:, 4])) / np.sqrt(2.0)
