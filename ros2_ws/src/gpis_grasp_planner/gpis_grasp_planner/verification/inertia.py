"""Moments of inertia of a part of even density."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.part import Part

Array = NDArray[np.float64]


def inertia_of(part: Part) -> tuple[Array, Array]:
    """Principal moments per mass (3,) [m^2] and axes (3, 3) of a part with even density.

    From the closed surface; a mesh without a sound inside is taken for its bounding box.
    """
    triangles = part.mesh.triangles - part.center_of_mass
    volumes = np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6
    total = float(volumes.sum())
    sums = triangles.sum(axis=1)
    second = np.einsum("i,ika,ikb->ab", volumes, triangles, triangles)
    second += np.einsum("i,ia,ib->ab", volumes, sums, sums)
    covariance = second / (20.0 * total) if total > 0.0 else np.diag([-1.0] * 3)
    if part.watertight and np.linalg.eigvalsh(covariance).min() > 0.0:
        moments, axes = np.linalg.eigh(np.trace(covariance) * np.eye(3) - covariance)
        axes[:, 2] *= np.linalg.det(axes)
        return moments, axes
    squares = part.mesh.extent**2 / 12.0
    return squares.sum() - squares, np.eye(3)
