"""A triangle mesh in metres, as the rest of the planner sees it: arrays and a content hash."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Vertices (n, 3) [m] and faces (m, 3), counter-clockwise seen from outside."""

    vertices: Array
    faces: NDArray[np.int32]

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 (hex) of the geometry: vertices as float64 in metres, then faces as int32."""
        digest = hashlib.sha256(np.ascontiguousarray(self.vertices, dtype="<f8").tobytes())
        digest.update(np.ascontiguousarray(self.faces, dtype="<i4").tobytes())
        return digest.hexdigest()

    @cached_property
    def triangles(self) -> Array:
        """Corner points of the faces, (m, 3, 3)."""
        return self.vertices[self.faces]

    @cached_property
    def _face_vectors(self) -> Array:
        a, b, c = self.triangles[:, 0], self.triangles[:, 1], self.triangles[:, 2]
        return np.cross(b - a, c - a)

    @cached_property
    def face_areas(self) -> Array:
        """Areas (m,) [m^2]."""
        return 0.5 * np.linalg.norm(self._face_vectors, axis=1)

    @cached_property
    def face_normals_outward(self) -> Array:
        """Unit normals (m, 3); zero for a face without area."""
        length = np.linalg.norm(self._face_vectors, axis=1, keepdims=True)
        return np.divide(
            self._face_vectors, length, out=np.zeros_like(self._face_vectors), where=length > 0
        )

    @cached_property
    def bounds(self) -> Array:
        """Axis-aligned box: rows lower and upper corner, (2, 3) [m]."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @property
    def extent(self) -> Array:
        """Edge lengths of the axis-aligned box, (3,) [m]."""
        return np.asarray(self.bounds[1] - self.bounds[0])

    @property
    def diagonal(self) -> float:
        """Diagonal of the axis-aligned box [m]."""
        return float(np.linalg.norm(self.extent))
