"""Where a hand is wanted to touch, found from its shapes: for descriptions that do not say it.

A link that closes touches with the side that moves ahead. Of that side a place or two along its
middle are taken, of the palm the middle of its face.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.mesh import TriangleMesh

Array = NDArray[np.float64]

_SAMPLES = 600
_AHEAD = np.cos(np.deg2rad(30.0))
_FAST = 0.3
_FACE_M = 1e-3
_LONG_M = 0.025
_PLACES = {False: (0.6,), True: (0.3, 0.8)}  # along a short side and a long one, outwards


def pads_of_link(
    pieces: Sequence[TriangleMesh], axis: Array, slides: bool
) -> list[tuple[Array, Array]]:
    """Points (3,) [m] with outward normals (3,), in the link's frame; none where no side is ahead.

    Parameters
    ----------
    pieces : sequence of TriangleMesh
        The link's, convex.
    axis : (3,) array
        Of its joint, through the frame's origin: turned about, or slid along.
    """
    if not pieces:
        return []
    points, normals = _samples(pieces)
    travel = np.broadcast_to(axis, points.shape) if slides else np.cross(axis, points)
    speed = np.linalg.norm(travel, axis=1)
    ahead = np.einsum("ij,ij->i", normals, travel) > _AHEAD * np.maximum(speed, 1e-12)
    ahead &= speed > _FAST * speed.max()  # the face about the joint turns on the spot
    if not ahead.any():
        return []
    points, normals = points[ahead], normals[ahead]
    middle = points.mean(axis=0)
    along = np.linalg.svd(points - middle, full_matrices=False)[2][0]
    if along @ middle < 0.0:  # outwards from the joint
        along = -along
    place = (points - middle) @ along
    aside = np.linalg.norm(points - middle - place[:, None] * along, axis=1)
    shares = _PLACES[bool(np.ptp(place) > _LONG_M)]
    chosen = [int(np.argmin(np.abs(place - np.quantile(place, s)) + aside)) for s in shares]
    return [(points[k], normals[k]) for k in chosen]


def pad_of_palm(pieces: Sequence[TriangleMesh]) -> list[tuple[Array, Array]]:
    """The middle of the palm's face, which looks along z; none where nothing is flat there."""
    if not pieces:
        return []
    points, normals = _samples(pieces)
    top = (points[:, 2] > points[:, 2].max() - _FACE_M) & (normals[:, 2] > 0.99)
    if not top.any():
        return []
    points, normals = points[top], normals[top]
    k = int(np.argmin(np.linalg.norm(points - points.mean(axis=0), axis=1)))
    return [(points[k], normals[k])]


def _samples(pieces: Sequence[TriangleMesh]) -> tuple[Array, Array]:
    from gpis_grasp_planner.geometry.surface_samples import uniform_samples  # SciPy, 40 MB

    made = [uniform_samples(piece, _SAMPLES, seed=0) for piece in pieces]
    return np.concatenate([m.points for m in made]), np.concatenate(
        [m.normals_outward for m in made]
    )
