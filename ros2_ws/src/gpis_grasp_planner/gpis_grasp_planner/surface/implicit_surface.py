"""Gaussian process implicit surface: value, gradient and variance for batches of points.

The surface is the zero set of ``f_GPIS`` (section III of the paper); outside f is positive. The
samples' normals enter as observations of the gradient, of unit length, so that near the surface
f is the signed distance in metres and ``|f| <= epsilon_c`` (0.2 mm) of the contact constraint
means what it says.

Near the surface f is the blend of local posteriors of :mod:`.patches`. Farther away f passes
smoothly into the signed distance to the nearest sample (:mod:`.far_field`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_triangular
from scipy.spatial import cKDTree

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.surface import blend, kernels, sampling
from gpis_grasp_planner.surface.far_field import BAND, FADE_WEIGHT, posterior_share
from gpis_grasp_planner.surface.patches import (
    KernelParameters,
    Patches,
    build_grid,
    factorise,
    fit_patches,
)
from gpis_grasp_planner.surface.settings import SurfaceSettings

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_FEWEST_SAMPLES = 4


class ImplicitSurface:
    """A fitted surface; make one with :meth:`fit` or :func:`fit_part`.

    Attributes
    ----------
    points : (n, 3) array [m]
        The samples it was fitted to, duplicates merged.
    normals_outward : (n, 3) array
        Their unit normals.
    settings : SurfaceSettings
    jitter : float
        The largest relative jitter that a covariance matrix needed; 0 for ordinary samples.
    """

    def __init__(
        self,
        points: Array,
        normals_outward: Array,
        tree: cKDTree,
        patches: Patches,
        settings: SurfaceSettings,
    ):
        self.points = points
        self.normals_outward = normals_outward
        self.settings = settings
        self.jitter = patches.jitter
        self._tree = tree
        self._patches = patches
        self._kernel = KernelParameters.from_settings(settings)
        grid = build_grid(patches)
        self._arrays = (
            grid.low, grid.cell, grid.size, grid.offset, grid.patch,
            patches.center, patches.scale, patches.radius, patches.start,
            patches.local, patches.weights, patches.trend,
            self._kernel.kind, self._kernel.a, self._kernel.variance,
        )  # fmt: skip

    @classmethod
    def fit(
        cls,
        points_surface: ArrayLike,
        normals_outward: ArrayLike,
        settings: SurfaceSettings | None = None,
        on_share: Callable[[float], None] = lambda _: None,
    ) -> Self:
        """Fit to surface samples and their outward normals.

        Parameters
        ----------
        points_surface : (n, 3) array [m]
            On thin walls both sides must be sampled, about as densely as the wall is thick.
        normals_outward : (n, 3) array
            Of any positive length.
        settings : SurfaceSettings, optional
        on_share : callable, optional
            Called every few ms with the share that is done; what it raises ends the fit.

        Raises
        ------
        MeshError
            MESH_NOT_FINITE for NaN or infinity, MESH_DEGENERATE for fewer than four distinct
            samples, a zero normal, or a covariance that no jitter makes definite.
        """
        settings = settings or SurfaceSettings()
        points, normals = _checked_samples(points_surface, normals_outward)
        points, normals = merge_duplicates(points, normals, settings.duplicate_tolerance_m)
        if len(points) < _FEWEST_SAMPLES:
            raise MeshError(
                f"{len(points)} distinct surface samples with a definite normal are left; at "
                f"least {_FEWEST_SAMPLES} are needed. Sample the surface more densely.",
                ErrorCode.MESH_DEGENERATE,
            )
        tree = cKDTree(points)
        patches = fit_patches(points, normals, tree, settings, on_share)
        return cls(points, normals, tree, patches, settings)

    def as_arrays(self) -> dict[str, Array | IntArray | float]:
        """Everything that the fit found, by name, for :meth:`from_arrays`."""
        return {
            "points": self.points,
            "normals_outward": self.normals_outward,
            **{f"patches.{f.name}": getattr(self._patches, f.name) for f in fields(Patches)},
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]], settings: SurfaceSettings) -> Self:
        """The surface whose :meth:`as_arrays` these are, fitted with the same settings."""
        patches: dict[str, Any] = {f.name: arrays[f"patches.{f.name}"] for f in fields(Patches)}
        patches["jitter"] = float(patches["jitter"])
        points = arrays["points"]
        return cls(
            points,
            arrays["normals_outward"],
            cKDTree(points),
            Patches(**patches),
            settings,
        )

    @property
    def n_patches(self) -> int:
        """Number of local Gaussian processes."""
        return len(self._patches.scale)

    def value(self, points: ArrayLike) -> Array:
        """f_GPIS (n,) [m] at points (n, 3): 0 on the surface, positive outside."""
        return self.value_and_gradient(points)[0]

    def gradient(self, points: ArrayLike) -> Array:
        """Gradient (n, 3) of f_GPIS at points (n, 3), about of unit length near the surface."""
        return self.value_and_gradient(points)[1]

    def value_and_gradient(self, points: ArrayLike) -> tuple[Array, Array]:
        """Both at once for points (n, 3), at the cost of one: some 2-5 us a point."""
        x = _checked_points(points)
        total, total_gradient, value, gradient, reach, reach_gradient = blend.evaluate(
            x, *self._arrays
        )
        safe = np.where(total > 0.0, total, 1.0)
        value /= safe
        gradient -= value[:, None] * total_gradient
        gradient /= safe[:, None]
        distance, nearest = self._nearest_sample(x)
        # A point nearer to a sample than this keeps the posterior as it is.
        inner = BAND[0] * reach / safe
        rows = np.flatnonzero((distance > inner) | (total < FADE_WEIGHT))
        if not len(rows):
            return value, gradient
        x, distance, nearest = x[rows], distance[rows], nearest[rows]
        mean, direction, side = self._far_field(x, distance, nearest)
        S, dS = total[rows], total_gradient[rows]
        share, d_share = posterior_share(
            distance, direction, S, dS, reach[rows], reach_gradient[rows]
        )
        surplus = value[rows] - mean
        value[rows] = mean + share * surplus
        gradient[rows] = (
            share[:, None] * gradient[rows]
            + ((1.0 - share) * side)[:, None] * direction
            + surplus[:, None] * d_share
        )
        return value, gradient

    def variance(self, points: ArrayLike) -> Array:
        """Variance (n,) [m^2] at points (n, 3): near 0 at the samples, growing away from them.

        The square of ``sum_j w_j sigma_j / sum_j w_j``, which bounds the standard deviation of the
        blend from above however the local posteriors are correlated. In the far field it passes
        into the squared distance to the nearest sample: nothing but a slope of at most one is
        known there. Factorises the touched patches anew (some 0.2 ms each).
        """
        x = _checked_points(points)
        p, kernel = self._patches, self._kernel
        weight = np.zeros(len(x))
        deviation = np.zeros(len(x))
        tree = cKDTree(x)
        for j in range(self.n_patches):
            rows = np.array(tree.query_ball_point(p.center[j], p.radius[j]), dtype=np.intp)
            if not len(rows):
                continue
            q = (x[rows] - p.center[j]) / p.scale[j]
            t = np.linalg.norm(x[rows] - p.center[j], axis=1) / p.radius[j]
            w = (1.0 - t).clip(0.0) ** 4 * (4.0 * t + 1.0)
            local = p.local[p.start[j] : p.start[j + 1]]
            factor, _ = factorise(local, kernel)
            cross = kernels.covariance(
                kernel.kind, kernel.a, kernel.variance, kernel.trend, local, q
            )[:, ::4]
            half = solve_triangular(factor, cross, lower=True, check_finite=False)
            prior = kernel.variance + kernel.trend * (1.0 + np.einsum("ij,ij->i", q, q))
            remaining = (prior - np.einsum("ij,ij->j", half, half)).clip(0.0)
            weight[rows] += w
            deviation[rows] += w * p.scale[j] * np.sqrt(remaining)
        total, total_gradient, _, _, reach, reach_gradient = blend.evaluate(x, *self._arrays)
        distance, _ = self._nearest_sample(x)
        share, _ = posterior_share(
            distance, np.zeros_like(x), total, total_gradient, reach, reach_gradient
        )
        deviation /= np.where(weight > 0.0, weight, 1.0)
        return (share * deviation + (1.0 - share) * distance) ** 2

    def _nearest_sample(self, x: Array) -> tuple[Array, NDArray[np.intp]]:
        distance, nearest = self._tree.query(x)
        return np.asarray(distance), np.asarray(nearest)

    def _far_field(
        self, x: Array, distance: Array, nearest: NDArray[np.intp]
    ) -> tuple[Array, Array, Array]:
        """Signed distance to the nearest sample, direction away from it, and the sign.

        The sign is that of the posterior on the way from the nearest sample to x, still within
        the patches: that way does not cross the surface, or another sample would be nearer. The
        nearest sample's own normal would not do: in front of a thin wall the nearest sample may
        be one of its back.
        """
        offset = x - self.points[nearest]
        direction = np.divide(
            offset,
            distance[:, None],
            out=self.normals_outward[nearest].copy(),
            where=distance[:, None] > 0.0,
        )
        step = np.minimum(distance, BAND[0] * self._patches.sample_reach[nearest])
        probe = self.points[nearest] + step[:, None] * direction
        total, _, value, _, _, _ = blend.evaluate(probe, *self._arrays)
        along = np.einsum("ij,ij->i", direction, self.normals_outward[nearest])
        side = np.where(np.where(total > 0.0, value, along) >= 0.0, 1.0, -1.0)
        return side * distance, direction, side


def fit_part(
    part_mesh: TriangleMesh,
    settings: SurfaceSettings | None = None,
    seed: int = 0,
    on_share: Callable[[float], None] = lambda _: None,
) -> ImplicitSurface:
    """Sample a mesh evenly and fit its implicit surface; the seed decides the samples.

    `on_share` is that of :meth:`ImplicitSurface.fit`.
    """
    settings = settings or SurfaceSettings()
    points, normals = sampling.sample_surface(part_mesh, settings.n_samples, seed)
    return ImplicitSurface.fit(points, normals, settings, on_share)


def merge_duplicates(points: Array, normals: Array, tolerance: float) -> tuple[Array, Array]:
    """Merge samples closer than `tolerance` [m]; their normals are averaged.

    Samples whose normals cancel (a sheet without thickness) say nothing about a side and are
    left out.
    """
    if tolerance > 0.0:
        key = np.round((points - points.min(axis=0)) / tolerance)
        _, first, group = np.unique(key, axis=0, return_index=True, return_inverse=True)
        if len(first) < len(points):
            group = group.ravel()
            count = np.bincount(group)[:, None]
            points = np.stack([np.bincount(group, c) for c in points.T], axis=1) / count
            normals = np.stack([np.bincount(group, c) for c in normals.T], axis=1) / count
    length = np.linalg.norm(normals, axis=1)
    definite = length > 0.1
    return points[definite], normals[definite] / length[definite, None]


def _checked_samples(points: ArrayLike, normals: ArrayLike) -> tuple[Array, Array]:
    points, normals = _checked_points(points), _checked_points(normals)
    if points.shape != normals.shape:
        raise MeshError(
            f"{len(points)} surface samples come with {len(normals)} normals; give one each.",
            ErrorCode.MESH_DEGENERATE,
        )
    length = np.linalg.norm(normals, axis=1)
    if len(length) and not length.min() > 0.0:
        raise MeshError(
            f"The normal of surface sample {int(length.argmin())} is zero; give a direction.",
            ErrorCode.MESH_DEGENERATE,
        )
    return points, normals / length[:, None]


def _checked_points(points: ArrayLike) -> Array:
    x = np.ascontiguousarray(points, dtype=np.float64)
    if x.ndim != 2 or x.shape[1] != 3:
        raise MeshError(
            f"Points have the shape {x.shape}; (n, 3) is needed.", ErrorCode.MESH_DEGENERATE
        )
    if not math.isfinite(x.sum()) and not np.isfinite(x).all():
        raise MeshError(
            f"Point {int(np.flatnonzero(~np.isfinite(x).all(axis=1))[0])} is not finite; "
            "remove NaN and infinity.",
            ErrorCode.MESH_NOT_FINITE,
        )
    return x
