"""What every reader of a point cloud gives, and the checks they share."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, MeshError

Array = NDArray[np.float64]

CLOUD_SUFFIXES = (".pcd", ".xyz")  # and .ply, where it has no faces


@dataclass(frozen=True, eq=False)
class ParsedCloud:
    """A cloud as its file has it, in the file's own numbers.

    Attributes
    ----------
    points : (n, 3) array
        Finite.
    normals : (n, 3) array or None
        The file's own; None where it has none.
    viewpoints : (k, 3) array
        Where the sensor stood, in the same numbers; (0, 3) where the file does not tell.
    notes : tuple of str
        What was passed over or assumed.
    """

    points: Array
    normals: Array | None = None
    viewpoints: Array = field(default_factory=lambda: np.zeros((0, 3)))
    notes: tuple[str, ...] = ()


def check_points(points: Array, name: str) -> None:
    """Refuse points that are not finite; the message names the first, counted from 1."""
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if bad.size:
        raise MeshError(
            f"{name}: point {bad[0] + 1} is not finite ({bad.size} such points of {len(points)}). "
            "Remove them from the cloud and export it again.",
            ErrorCode.MESH_NOT_FINITE,
        )


def check_point_count(count: int, name: str, most: int) -> None:
    """Refuse a cloud without points, or with more than `most`."""
    if count > most:
        raise MeshError(
            f"{name} has {count} points, the limit is {most}. Thin the cloud, or raise the setting "
            "catalogue.max_faces.",
            ErrorCode.MESH_TOO_LARGE,
        )
    if count <= 0:
        raise MeshError(f"{name} has no points. Export it again.", ErrorCode.MESH_EMPTY)


def own_normals(columns: Array) -> Array | None:
    """Normals (n, 3) if every one is finite and not zero; else None."""
    length = np.linalg.norm(columns, axis=1)
    return columns if len(columns) and np.isfinite(length).all() and length.min() > 0.0 else None
