"""Whether a part has a force-closure grasp at all for a hand that spans so much: a bound.

All contacts of a grasp lie in a ball of the hand's reach. If the inward normals of all faces
within a ball make less than 90 degrees less the friction angle with one direction d, then every
force inside their friction cones has a positive part along d: no such forces add up to nothing,
and no grasp whose contacts lie in that ball has force closure. Where this is so of every ball, the
part has none. Contacts on an edge have normals between those of its faces, for which it holds too.

A part on a plane has less to offer. A hand point that touches keeps a margin m from the plane, and
is off the surface along its outward normal n by a gap g at most: what is touched at height z has
z + g n_z >= m. Where z is less than m - g sin(friction angle), n_z is more than the sine, and all
forces in the friction cone point down. So with d down the rule needs to be looked at for the faces
at higher corners alone.

The bounds are one-sided: where they say nothing, the part may or may not be graspable.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.mesh import TriangleMesh

Array = NDArray[np.float64]

_BALL_STEP = 0.4  # of the radius: between the balls' centres
_SAMPLE_STEP = 0.15  # of the radius: between points on a face
_MOST_SAMPLES = 40_000
_MOST_BALLS = 40_000
_ROUNDS = 60
_AT_ONCE = 256


def has_no_force_closure(
    mesh: TriangleMesh,
    faces: NDArray[np.intp],
    radius: float,
    friction: float,
    late: Callable[[], bool] = lambda: False,
) -> bool:
    """Whether no grasp on these faces has force closure; False where that is not known.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : (k,) int array
        That the hand can come to.
    radius : float [m]
        Of a ball that holds all contacts of a grasp.
    friction : float
        The largest of the pairs of hand and part.
    late : callable
        Ends the looking, with False.
    """
    if not len(faces):
        return True
    step = _SAMPLE_STEP * radius
    n = np.ceil(_longest_edge(mesh.triangles[faces]) / step).astype(int).clip(1)
    if ((n + 1) * (n + 2) // 2).sum() > _MOST_SAMPLES:
        return False
    points, owner = _samples(mesh.triangles[faces], n)
    normals = -mesh.face_normals_outward[faces]
    low, high = points.min(axis=0), points.max(axis=0)
    if np.linalg.norm(high - low) <= 2.0 * radius and not _one_sided(normals, friction):
        return False  # all of it in one ball: the usual part
    return _everywhere_one_sided(points, owner, normals, radius, step, friction, late)


def is_only_pressed_down(
    mesh: TriangleMesh,
    up: Array,
    heights: Array,
    friction: float,
    margin: float,
    gap: float,
) -> bool:
    """Whether a hand that keeps a margin from a plane can only press the part down on it.

    Parameters
    ----------
    mesh : TriangleMesh
        Closed: what is touched is touched from outside.
    up : (3,) array
        Away from the plane.
    heights : (v,) array [m]
        Of the vertices over the plane.
    friction : float
        The largest of the pairs of hand and part.
    margin : float [m]
    gap : float [m]
        Largest distance at which a hand point counts as touching.
    """
    least = math.sin(math.atan(friction))
    high = heights >= margin - gap * least
    normals = mesh.face_normals_outward[high[mesh.faces].any(axis=1)]
    normals = normals[np.linalg.norm(normals, axis=1) > 0.5]  # faces without area have none
    return bool((normals @ up > least + 1e-9).all())


def is_one_sided(mesh: TriangleMesh, faces: NDArray[np.intp], friction: float) -> bool:
    """Whether a direction is found that all forces on these faces together point along."""
    return _one_sided(-mesh.face_normals_outward[faces], friction)


def _everywhere_one_sided(
    points: Array,
    owner: NDArray[np.intp],
    normals: Array,
    radius: float,
    step: float,
    friction: float,
    late: Callable[[], bool],
) -> bool:
    from scipy.spatial import cKDTree  # not for everyone who imports this module: 35 MB

    apart = _BALL_STEP * radius
    # A point of a face is at most `step` from a sample, a ball at most half a diagonal from a
    # centre of the grid.
    wide = radius + step + 0.5 * math.sqrt(3.0) * apart
    low, high = points.min(axis=0) - radius, points.max(axis=0) + radius
    counts = np.ceil((high - low) / apart).astype(int) + 1
    if counts.prod() > _MOST_BALLS:
        return False
    grid = np.stack(np.meshgrid(*(np.arange(k) for k in counts), indexing="ij"), axis=-1)
    centres = low + apart * grid.reshape(-1, 3)
    tree, seen = cKDTree(points), set()
    for first in range(0, len(centres), _AT_ONCE):
        for rows in tree.query_ball_point(centres[first : first + _AT_ONCE], wide):
            found = np.unique(owner[rows])
            if not len(found) or (key := found.tobytes()) in seen:
                continue
            seen.add(key)
            if late() or not _one_sided(normals[found], friction):
                return False
    return True


def _one_sided(normals: Array, friction: float) -> bool:
    """Whether a direction is found that all friction cones about these normals point along."""
    normals = normals[np.linalg.norm(normals, axis=1) > 0.5]  # faces without area have none
    if not len(normals):
        return True
    least = math.sin(math.atan(friction))
    along = normals.mean(axis=0)
    for round_ in range(_ROUNDS):
        length = float(np.linalg.norm(along))
        if length < 1e-9:
            return False
        cosines = normals @ (along / length)
        worst = int(np.argmin(cosines))
        if cosines[worst] > least + 1e-9:
            return True
        along = along / length + normals[worst] / (round_ + 2.0)
    return False


def _longest_edge(triangles: Array) -> Array:
    edges = triangles - np.roll(triangles, 1, axis=1)
    return np.asarray(np.linalg.norm(edges, axis=2).max(axis=1))


def _samples(triangles: Array, n: NDArray[np.intp]) -> tuple[Array, NDArray[np.intp]]:
    """Corners of each triangle's division into n^2 alike, and the triangle of each."""
    points, owner = [], []
    for k in np.unique(n):
        rows = np.flatnonzero(n == k)
        i, j = np.meshgrid(np.arange(k + 1), np.arange(k + 1), indexing="ij")
        i, j = i[i + j <= k], j[i + j <= k]
        weights = np.stack([i, j, k - i - j], axis=1) / k
        points.append((weights @ triangles[rows]).reshape(-1, 3))
        owner.append(np.repeat(rows, len(weights)))
    return np.concatenate(points), np.concatenate(owner)
