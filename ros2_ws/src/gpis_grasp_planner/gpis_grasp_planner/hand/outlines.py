"""Outlines of links in their plane, and the bars that are extruded from them.

Any unit of length; links are drawn in millimetres.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

Array = NDArray[np.float64]


def arc(
    center: tuple[float, float], radius: float, start_deg: float, end_deg: float, n: int
) -> Array:
    """Points (n, 2) on a circle, ends included, by angle from the first axis."""
    angle = np.radians(np.linspace(start_deg, end_deg, n))
    return np.asarray(center) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def crown(apex: tuple[float, float], radius: float, start: float, end: float, n: int) -> Array:
    """Points (n, 2) on a shallow arc that culminates in `apex`, for abscissae start..end."""
    x = np.linspace(start, end, n)
    drop = radius - np.sqrt(radius**2 - (x - apex[0]) ** 2)
    return np.stack([x, apex[1] - drop], axis=1)


def inset(outline: Array, amount: float) -> Array:
    """Move the vertices of a convex outline (n, 2) inwards along the mean edge normals."""
    ring = outline[ConvexHull(outline).vertices]
    edge = np.roll(ring, -1, axis=0) - ring
    normal = np.stack([edge[:, 1], -edge[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    mean = normal + np.roll(normal, 1, axis=0)
    # Dividing by the half angle's cosine keeps the edges, not the corners, `amount` apart.
    mean /= 0.5 * np.sum(mean**2, axis=1, keepdims=True)
    return np.asarray(ring - amount * mean)


def bar(outline: Array, half_width: float, chamfer: float) -> Array:
    """Extrude an (x, y) outline to z = +-half_width with its rims chamfered; points (n, 3)."""
    rings = [
        (outline, half_width - chamfer),
        (outline, chamfer - half_width),
        (inset(outline, chamfer), half_width),
        (inset(outline, chamfer), -half_width),
    ]
    return np.vstack([np.column_stack([ring, np.full(len(ring), z)]) for ring, z in rings])
