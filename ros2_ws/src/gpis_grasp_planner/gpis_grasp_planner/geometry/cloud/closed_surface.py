"""The closed surface of a cloud's Gaussian process: its zero level, deviation and draws.

Lengths are metres outside and half diagonals of the cloud inside, so that one kernel fits all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.cloud.library import open3d
from gpis_grasp_planner.geometry.cloud.prior import Ellipsoid
from gpis_grasp_planner.geometry.cloud.process import (
    Kernel,
    Observations,
    Posterior,
    cholesky,
    value_covariance,
)
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.topology import bodies

Array = NDArray[np.float64]

_MARGIN = 0.35  # of the grid about the cloud and the prior, in half diagonals
_KERNEL = Kernel(length=0.2, slope=0.7)
_CONTROL = 250
_CONTROL_JITTER = 1e-6


@dataclass(frozen=True, eq=False)
class Grid:
    """Values (nx, ny, nz) at ``origin + spacing * index``."""

    origin: Array
    spacing: float
    values: Array

    def nodes(self) -> Array:
        """Positions (nx ny nz, 3) of the values [m]."""
        index = np.stack(np.meshgrid(*map(np.arange, self.values.shape), indexing="ij"), axis=-1)
        return self.origin + self.spacing * index.reshape(-1, 3)


class CloudProcess:
    """A fitted process over a cloud.

    Parameters
    ----------
    seen : Observations
        In metres.
    """

    def __init__(self, seen: Observations):
        low, high = seen.points.min(axis=0), seen.points.max(axis=0)
        self._middle, self._unit = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
        self._seen = Observations(
            (seen.points - self._middle) / self._unit,
            seen.normals_outward,
            seen.noise / self._unit,
            seen.noise_normal,
        )
        x = self._seen.points
        self.prior = Ellipsoid.of(x, seen.normals_outward)
        self._posterior = Posterior.of(
            _KERNEL, self._seen, self.prior.value(x), self.prior.gradient(x)
        )

    def value(self, points: Array) -> Array:
        """The signed distance expected (n,) [m] at points (n, 3) [m], positive outside."""
        return self._unit * self._value((points - self._middle) / self._unit)

    def _value(self, q: Array) -> Array:
        return self.prior.value(q) + self._posterior.shift(q)

    def grid(self, cells: int) -> Grid:
        """Values on a grid of so many cells along its longest axis."""
        x = self._seen.points
        reach = np.sqrt(((self.prior.axes * self.prior.half) ** 2).sum(axis=1))
        low = np.minimum(x.min(axis=0), self.prior.center - reach) - _MARGIN
        high = np.maximum(x.max(axis=0), self.prior.center + reach) + _MARGIN
        spacing = float((high - low).max()) / cells
        axes = [np.arange(a, b + spacing, spacing) for a, b in zip(low, high, strict=True)]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        values = self._value(nodes.reshape(-1, 3)).reshape(nodes.shape[:3])
        return Grid(
            self._middle + self._unit * nodes[0, 0, 0], self._unit * spacing, self._unit * values
        )

    def deviation(self, points: Array) -> Array:
        """Standard deviation (n,) [m] of the value at points (n, 3) [m]."""
        return self._unit * self._posterior.deviation((points - self._middle) / self._unit)

    def draws(self, count: int, about: Array, at: Array, seed: int) -> Array:
        """What to add to the value at points (m, 3) for a draw: (count, m) [m].

        Drawn at some points of the surface `about` (n, 3), and carried on from there as the
        kernel does.
        """
        from scipy.linalg import cho_solve

        step = max(1, len(about) // _CONTROL)
        c = np.ascontiguousarray((about[::step] - self._middle) / self._unit)
        q = np.ascontiguousarray((at - self._middle) / self._unit)
        prior = value_covariance(*_KERNEL.scalars, c, c)
        floor = np.full(len(c), _CONTROL_JITTER)
        root = cholesky(self._posterior.covariance(c), floor)
        drawn = root @ np.random.default_rng(seed).standard_normal((len(c), count))
        weights = cho_solve((cholesky(prior, floor), True), drawn)
        return self._unit * (value_covariance(*_KERNEL.scalars, q, c) @ weights).T


def zero_level(grid: Grid, name: str) -> TriangleMesh:
    """The largest closed piece of a grid's zero level, its faces counter-clockwise from outside.

    By Open3D's flying edges. The grid's border counts as outside; pieces apart from the largest,
    among them bubbles inside it, are what the process dreams up where nothing was seen.

    Raises
    ------
    MeshError
        MESH_DEGENERATE where nothing is inside.
    """
    o3d = open3d()
    values = grid.values.copy()
    for axis in range(3):
        for side in (0, -1):
            border = np.moveaxis(values, axis, 0)[side]
            np.maximum(border, grid.spacing, out=border)
    if not (values < 0.0).any():
        raise MeshError(
            f"{name}: no closed surface goes with its points; their normals may be mixed up. Tell "
            "where the sensor stood ('viewpoints' in its YAML file), or scan more densely.",
            ErrorCode.MESH_DEGENERATE,
        )
    # A value of exactly 0 would make faces without area.
    values[np.abs(values) < 1e-3 * grid.spacing] = 1e-3 * grid.spacing
    single = np.ascontiguousarray(values.transpose(2, 1, 0), dtype=np.float32)
    volume = o3d.core.Tensor.from_numpy(single)
    made = o3d.t.geometry.TriangleMesh.create_isosurfaces(volume, [0.0])
    vertices = made.vertex.positions.numpy().astype(np.float64) * grid.spacing + grid.origin
    faces = made.triangle.indices.numpy().astype(np.int32)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volumes = np.bincount(bodies(faces)[1], np.einsum("ij,ij->i", a, np.cross(b, c)))
    largest = int(np.abs(volumes).argmax())
    kept = faces[bodies(faces)[1] == largest]
    if volumes[largest] < 0.0:
        kept = kept[:, ::-1]
    used, kept = np.unique(kept, return_inverse=True)
    return TriangleMesh(vertices[used], kept.reshape(-1, 3).astype(np.int32))
