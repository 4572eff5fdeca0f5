"""How well a part's surface is known, where it came from a scan and not from a CAD file."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.mesh import TriangleMesh

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SurfaceUncertainty:
    """The standard deviation of a part's surface, and other surfaces that it may have.

    Attributes
    ----------
    points : (n, 3) array [m]
        On the surface.
    deviation : (n,) array [m]
        Standard deviation there, across the surface.
    draws : tuple of TriangleMesh
        Surfaces drawn from the same distribution.
    """

    points: Array
    deviation: Array
    draws: tuple[TriangleMesh, ...]

    def deviation_at(self, points: Array) -> Array:
        """Standard deviation (m,) [m] at the surface points nearest to points (m, 3)."""
        _, nearest = self._tree.query(points)
        return self.deviation[nearest]

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 (hex) of all of it."""
        digest = hashlib.sha256()
        for array in (self.points, self.deviation):
            digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
        for surface in self.draws:
            digest.update(surface.content_hash.encode())
        return digest.hexdigest()

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self.points)
