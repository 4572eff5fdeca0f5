"""Outward normals of a cloud: by where the sensor stood, the file's own, else all together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.cloud.cleaning import to_open3d
from gpis_grasp_planner.geometry.cloud.library import open3d
from gpis_grasp_planner.geometry.cloud.views import View, spacing_of

Array = NDArray[np.float64]

_TANGENT_NEIGHBOURS = 12
_SHIFT = 1e-3  # of the points' spacing
_NEIGHBOUR_VOTES = 16
_CLEAR = 0.25  # cosine between ray and normal above which a viewpoint decides the side
_ROUNDS = 60
_OWN = 8.0  # weight of a grazing point's own vote: a flat face that grazes as a whole keeps it
_BEHIND = 0.3  # of the depth of the whole cloud: far behind what hides it
_HIDDEN = 0.1  # share of points that no viewpoint saw, from which on it is said


@dataclass(frozen=True, eq=False)
class Oriented:
    """Unit normals (n, 3) that point outward, and a note of how that was decided."""

    normals_outward: Array
    note: str


def outward_normals(
    points: Array, neighbours: int, own: Array | None, views: Sequence[View]
) -> Oriented:
    """Estimate normals by planes through neighbours and turn them outward.

    Parameters
    ----------
    points : (n, 3) array [m]
    neighbours : int
        For one plane.
    own : (n, 3) array or None
        The file's normals. They give the side; the direction is estimated, as they may be noisy.
    views : sequence of View
        From where the sensor stood; may be empty. A point that a viewpoint saw faces it.
    """
    cloud = to_open3d(points)
    cloud.estimate_normals(open3d().geometry.KDTreeSearchParamKNN(neighbours))
    normals = np.asarray(cloud.normals).copy()
    if views:
        normals = _towards(points, normals, views)
        n = len(views)
        seen = np.any([view.sees(_BEHIND) for view in views], axis=0)
        hidden = 1.0 - float(seen.mean())
        given = f"{n} viewpoint{'s' if n > 1 else ''} given"
        note = f"Normals point to where the sensor stood ({given})."
        if hidden > _HIDDEN:
            note += (
                f" {100.0 * hidden:.0f} % of the points were seen from none of them and follow "
                "their neighbours. Are all viewpoints given?"
            )
        return Oriented(normals, note)
    if own is not None and (length := np.linalg.norm(own, axis=1)).min() > 0.0:
        unit = own / length[:, None]
        normals *= np.where(np.einsum("ij,ij->i", normals, unit) < 0.0, -1.0, 1.0)[:, None]
        how = "Normals are on the side of the file's own"
    else:
        normals = _agreeing(points, normals)
        how = "No viewpoint is known: normals were made to agree with their neighbours"
    if points_inward(points, normals):
        return Oriented(-normals, f"{how}, then all turned: most pointed inward.")
    return Oriented(normals, f"{how}; most point outward.")


def points_inward(points: Array, normals: Array) -> bool:
    """Whether normals (n, 3) point into the body, as a whole.

    By the sign of ``sum n.(p - mean p)``, which is three times the volume over the area for a
    closed body, and positive for any convex piece of one.
    """
    return float(np.einsum("ij,ij->", normals, points - points.mean(axis=0))) < 0.0


def _agreeing(points: Array, normals: Array) -> Array:
    """Normals on one side of the surface, from neighbour to neighbour.

    By Open3D on points that are moved a little. Points that lie in planes to the last digit, as
    sampled from CAD, take it 40 s for 20,000, and six times as long for twice as many.
    """
    shift = np.random.default_rng(0).standard_normal(points.shape)
    moved = to_open3d(points + _SHIFT * spacing_of(points) * shift)
    moved.normals = open3d().utility.Vector3dVector(normals)
    moved.orient_normals_consistent_tangent_plane(_TANGENT_NEIGHBOURS)
    return np.asarray(moved.normals).copy()


def _towards(points: Array, normals: Array, views: Sequence[View]) -> Array:
    """Normals turned to the viewpoints that saw their points; grazing ones as their neighbours.

    Where a ray grazes the surface a normal's error decides on which side the viewpoint is: those
    points take their side from neighbours with like normals, from where the side is clear outwards.
    """
    from scipy.spatial import cKDTree

    vote = np.zeros(len(points))
    for view in views:
        cosine = np.einsum("ij,ij->i", normals, view.viewpoint - points) / view.depth
        vote += np.where(view.sees(), cosine, 0.0)
    _, near = cKDTree(points).query(points, k=min(_NEIGHBOUR_VOTES, len(points)))
    alike = np.einsum("ij,ikj->ik", normals, normals[near])
    alike *= np.abs(alike)
    # The mean over neighbours: a point seen through a hole in the cloud has no voice alone.
    vote = (alike * vote[near]).sum(axis=1) / np.abs(alike).sum(axis=1)
    side = np.where(np.abs(vote) > _CLEAR, np.sign(vote), 0.0)
    for _ in range(_ROUNDS):
        total = (alike * side[near]).sum(axis=1) + _OWN * vote
        told = (side == 0.0) & (np.abs(total) > 1.0)
        if not told.any():
            break
        side[told] = np.sign(total[told])
    side = np.where(side == 0.0, np.where(vote < 0.0, -1.0, 1.0), side)
    # Once more by all neighbours: noise hides points from each other.
    total = (alike * side[near]).sum(axis=1)
    return normals * np.where(total < 0.0, -1.0, 1.0)[:, None]
