"""Meshes of simple shapes that a scene is drawn with."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.geometry.directions import even_directions
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.transforms import apply
from gpis_grasp_planner.hand.link_mesh import convex_hull
from gpis_grasp_planner.surface.chart import tangent_basis

Array = NDArray[np.float64]

_CORNERS = 24


def ellipsoid(center: ArrayLike, axes: ArrayLike, n: int = 400) -> TriangleMesh:
    """About `center` (3,) with half axes (3,) [m] along x, y, z; of `n` vertices."""
    return convex_hull(np.asarray(center) + even_directions(n) * np.asarray(axes))


def cone(tip: ArrayLike, axis: ArrayLike, slope: float, length: float) -> TriangleMesh:
    """From `tip` (3,) along the unit `axis` (3,); radius over length is `slope`."""
    tip, axis = np.asarray(tip, dtype=float), np.asarray(axis, dtype=float)
    rim = disc_points(tip + length * axis, axis, max(slope, 1e-3) * length)
    return convex_hull(np.vstack([tip, rim]))


def disc_points(center: ArrayLike, normal: ArrayLike, radius: float) -> Array:
    """Points (24, 3) of a circle, in its order."""
    angle = np.linspace(0.0, 2.0 * np.pi, _CORNERS, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle)]) @ tangent_basis(normal).T
    return np.asarray(np.asarray(center) + radius * ring)


def slab(T: ArrayLike, size: ArrayLike) -> TriangleMesh:
    """A box of edges `size` (3,) [m] about the origin of the frame `T` (4, 4)."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    return convex_hull(apply(np.asarray(T), corners * np.asarray(size)))


def cylinder(T: Array, radius: float, length: float) -> TriangleMesh:
    """Along z of the frame `T` (4, 4), about its origin."""
    ends = [disc_points([0.0, 0.0, z], [0.0, 0.0, 1.0], radius) for z in (-length / 2, length / 2)]
    return convex_hull(apply(T, np.vstack(ends)))
