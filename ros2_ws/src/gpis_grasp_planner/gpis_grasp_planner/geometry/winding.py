"""Generalised winding number: how often a surface goes round a point.

1 inside a well-oriented closed surface and 0 outside it; -1 inside an inverted one, 2 where two
bodies overlap. Solid angles by A. Van Oosterom and J. Strackee, "The solid angle of a plane
triangle", IEEE Trans. Biomed. Eng. 1983, eq. (8).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
PAIRS_AT_ONCE = 400_000


def winding_numbers(triangles: Array, points: Array) -> Array:
    """Winding numbers (n,) of triangles (m, 3, 3) at points (n, 3); n m solid angles."""
    chunk = max(1, PAIRS_AT_ONCE // max(1, len(triangles)))
    parts = [_solid_angles(triangles, points[i : i + chunk]) for i in range(0, len(points), chunk)]
    return np.concatenate(parts) / (4.0 * np.pi) if parts else np.zeros(0)


def _solid_angles(triangles: Array, points: Array) -> Array:
    a, b, c = (triangles[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    determinant = np.einsum("ijk,ijk->ij", a, np.cross(b, c))
    denominator = (
        la * lb * lc
        + np.einsum("ijk,ijk->ij", a, b) * lc
        + np.einsum("ijk,ijk->ij", b, c) * la
        + np.einsum("ijk,ijk->ij", c, a) * lb
    )
    return np.asarray(2.0 * np.arctan2(determinant, denominator).sum(axis=1))
