"""The surface's samples with their charts: nearest point by a k-d tree, chart on demand."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.surface.chart import Chart
from gpis_grasp_planner.surface.implicit_surface import ImplicitSurface

Array = NDArray[np.float64]


class SurfaceAtlas:
    """Points of the surface, found by nearness, and the chart of each.

    Parameters
    ----------
    surface : ImplicitSurface
    points : (n, 3) array [m], optional
        Points on the surface; the samples of the fit by default.
    """

    def __init__(self, surface: ImplicitSurface, points: ArrayLike | None = None):
        chosen = surface.points if points is None else np.asarray(points, dtype=np.float64)
        if chosen.ndim != 2 or chosen.shape[1] != 3 or not len(chosen):
            raise MeshError(
                f"An atlas needs points of the shape (n, 3) with n > 0, not {chosen.shape}.",
                ErrorCode.MESH_DEGENERATE,
            )
        self.surface = surface
        self.points = chosen
        self._tree = cKDTree(chosen)
        self._charts: dict[int, Chart] = {}

    def nearest(self, points: ArrayLike) -> tuple[NDArray[np.intp], Array]:
        """Indices (n,) and positions (n, 3) of the atlas points nearest to points (n, 3)."""
        index = np.asarray(self._tree.query(np.asarray(points, dtype=np.float64))[1])
        return index, self.points[index]

    def chart(self, index: int) -> Chart:
        """Chart at atlas point `index`, made once; MeshError where the gradient vanishes."""
        key = int(index)
        if key not in self._charts:
            self._charts[key] = Chart.at(self.surface, self.points[key])
        return self._charts[key]
