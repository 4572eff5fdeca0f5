"""Polygons to triangles: fans where they are right, ears cut one by one where they are not.

A fan over a concave corner covers ground outside the polygon, and over a corner in the middle of
a straight side it has a triangle without area, which opens the surface where it is dropped. Both
are looked for in the polygon's mean plane (Newell's normal). Every corner of the polygon stays a
corner of triangles, so that neighbours still meet edge to edge.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, MeshError

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_FLAT = 1e-9  # area of what has none, relative to the polygon's own
_ABSURD = 1e60
_MOST_CORNERS = 20_000
_SMALL_SHARE = 1e-3  # of the surface, that skewed quads may be which cross themselves
_CROSSING_ROWS = 512


class _Crossing(Exception):
    """A polygon crosses itself."""


def triangulate(
    vertices: Array, corners: Index, counts: Index, name: str
) -> tuple[Index, Index, tuple[str, ...]]:
    """Split polygons into triangles, in their order.

    A quad of scans and remeshed parts may be so skewed that it crosses itself in its mean plane. It
    is a pair of triangles all the same, where such quads are a small share of the surface.

    Parameters
    ----------
    vertices : (n, 3) array
    corners : (c,) int array
        The vertices of all polygons, one after the other; indices are checked already.
    counts : (p,) int array
        Corners of each polygon, at least 3.
    name : str
        What messages call the file.

    Returns
    -------
    faces : (t, 3) int array
    first : (p + 1,) int array
        The first triangle of each polygon, and at the end their number. Equal corners in a row
        count once, so that a triangle written as a quad gives one triangle.
    notes : tuple of str
        Of quads that cross themselves.

    Raises
    ------
    MeshError
        MESH_DEGENERATE for another polygon that crosses itself.
    """
    if (counts == 3).all():
        return corners.reshape(-1, 3), np.arange(len(counts) + 1), ()
    _check_finite(vertices, corners, counts, name)
    corners, counts = _without_repeats(vertices, corners, counts)
    start = np.concatenate([[0], np.cumsum(counts)])
    first = np.concatenate([[0], np.cumsum(counts - 2)])
    faces = np.empty((int(first[-1]), 3), dtype=np.int64)
    skewed: list[int] = []
    for count in np.unique(counts):
        mine = np.flatnonzero(counts == count)
        group = corners[start[mine][:, None] + np.arange(count)]
        split = group[:, None, :] if count == 3 else _split(vertices, group, mine, name, skewed)
        faces[first[mine][:, None] + np.arange(count - 2)] = split
    return faces, first, _note_skewed(vertices, faces, first, skewed, name)


def _note_skewed(
    vertices: Array, faces: Index, first: Index, skewed: list[int], name: str
) -> tuple[str, ...]:
    if not skewed:
        return ()
    a, b, c = (np.clip(vertices[faces[:, k]], -_ABSURD, _ABSURD) for k in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    at = first[skewed]
    share = float(areas[at].sum() + areas[at + 1].sum()) / max(float(areas.sum()), 1e-300)
    if share > _SMALL_SHARE:
        raise _unsplit(name, skewed[0], "of 4 corners crosses itself")
    return (
        f"{len(skewed)} quads that cross themselves (the first is face {skewed[0] + 1}) were split "
        f"as they stand; they are {100 * share:.2g} % of the surface.",
    )


def _check_finite(vertices: Array, corners: Index, counts: Index, name: str) -> None:
    bad = np.flatnonzero(~np.isfinite(vertices[corners]).all(axis=1))
    if bad.size:
        face = int(np.searchsorted(np.cumsum(counts), bad[0], side="right"))
        raise MeshError(
            f"{name}: face {face + 1} has a vertex that is not finite (vertex "
            f"{corners[bad[0]] + 1}). Repair the mesh and export it again.",
            ErrorCode.MESH_NOT_FINITE,
        )


def _without_repeats(vertices: Array, corners: Index, counts: Index) -> tuple[Index, Index]:
    """Leave out corners at the same place as the one before; a polygon keeps at least three."""
    polygon = np.repeat(np.arange(len(counts)), counts)
    start = np.cumsum(counts) - counts
    before = np.arange(-1, len(corners) - 1)
    before[start] = start + counts - 1
    repeated = (vertices[corners] == vertices[corners[before]]).all(axis=1)
    repeated &= counts[polygon] > 3
    left = counts - np.bincount(polygon[repeated], minlength=len(counts))
    # Fewer than three are left: a face without area, which the judge of meshes decides on.
    rank = np.arange(len(corners)) - start[polygon]
    few = left < 3
    keep = np.where(few[polygon], rank < 3, ~repeated)
    return corners[keep], np.where(few, 3, left)


def _split(vertices: Array, group: Index, numbers: Index, name: str, skewed: list[int]) -> Index:
    """Triangles (k, c - 2, 3) of k polygons with c corners each (k, c).

    Quads that cross themselves are entered in `skewed` by their number.
    """
    k, count = group.shape
    points = vertices[group]
    # Absurd coordinates are refused by the judge of meshes; squares of them must not overflow.
    points = np.clip(points, -_ABSURD, _ABSURD) - np.clip(points[:, :1], -_ABSURD, _ABSURD)
    normals = np.cross(points, np.roll(points, -1, axis=1)).sum(axis=1)
    double_area = np.linalg.norm(normals, axis=1)
    unit = normals / np.where(double_area > 0, double_area, 1.0)[:, None]
    limit = _FLAT * double_area
    ahead = np.roll(points, -1, axis=1) - points
    turn = np.einsum("kcj,kj->kc", np.cross(np.roll(ahead, 1, axis=1), ahead), unit)
    convex = (turn >= -limit[:, None]).all(axis=1) | (count == 4)
    faces = np.empty((k, count - 2, 3), dtype=np.int64)
    open_ = np.flatnonzero(convex)  # a concave polygon has no fan worth a try
    for apex in range(count):
        turned = np.roll(np.arange(count), -apex)
        fan = points[open_][:, turned]
        spokes = fan[:, 1:] - fan[:, :1]
        areas = np.einsum("kcj,kj->kc", np.cross(spokes[:, :-1], spokes[:, 1:]), unit[open_])
        right = (areas > limit[open_][:, None]).all(axis=1)
        _write_fans(faces, group, open_[right], turned)
        open_ = open_[~right]
        if len(open_) == 0:
            break
    for i in [*open_, *np.flatnonzero(~convex)]:
        try:
            ears = _cut_ears(points[i], unit[i], float(double_area[i]), numbers[i], name)
        except _Crossing:
            if count != 4:
                raise _unsplit(name, numbers[i], f"of {count} corners crosses itself") from None
            skewed.append(int(numbers[i]))
            ears = np.array([(0, 1, 2), (0, 2, 3)])
        faces[i] = group[i][ears]
    return faces


def _write_fans(faces: Index, group: Index, rows: Index, turned: Index) -> None:
    around = group[rows][:, turned]
    faces[rows, :, 0] = around[:, :1]
    faces[rows, :, 1] = around[:, 1:-1]
    faces[rows, :, 2] = around[:, 2:]


def _cut_ears(points: Array, unit: Array, double_area: float, number: int, name: str) -> Index:
    """Triangles (c - 2, 3) of one polygon (c, 3), as indices of its corners."""
    count = len(points)
    fan = np.stack([np.zeros(count - 2), np.arange(1, count - 1), np.arange(2, count)], axis=1)
    size = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if size[1] <= 1e-9 * size[0]:
        return fan.astype(np.int64)  # all on one line: without area however it is split
    if count > _MOST_CORNERS:
        raise _unsplit(name, number, f"has {count} corners, at most {_MOST_CORNERS} can be split")
    if double_area <= _FLAT * float(size[0]) ** 2:
        raise _Crossing
    axis = np.eye(3)[np.argmin(np.abs(unit))]
    u = np.cross(axis, unit)
    u /= np.linalg.norm(u)
    flat = np.stack([points @ u, points @ np.cross(unit, u)], axis=1)
    if _crosses_itself(flat):
        raise _Crossing
    triangles = _ears(flat, _FLAT * double_area)
    if triangles is None:
        raise _unsplit(name, number, f"of {count} corners cannot be split into triangles")
    return triangles


def _ears(flat: Array, limit: float) -> Index | None:
    left = np.arange(len(flat))
    triangles: list[tuple[int, int, int]] = []
    i = 0
    strict = True
    tried = 0
    while len(left) > 3:
        n = len(left)
        a, b, c = left[(i - 1) % n], left[i % n], left[(i + 1) % n]
        if _is_ear(flat, left, (a, b, c), limit, strict):
            triangles.append((a, b, c))
            left = np.delete(left, i % n)
            i += 1  # the next ear elsewhere: fewer slivers
            tried, strict = 0, True
            continue
        i += 1
        tried += 1
        if tried > n:
            if not strict:
                return None
            tried, strict = 0, False
    triangles.append((left[0], left[1], left[2]))
    return np.array(triangles, dtype=np.int64)


def _is_ear(
    flat: Array, left: Index, ear: tuple[int, int, int], limit: float, strict: bool
) -> bool:
    """Whether a corner with area can be cut off: no other corner in it (strict: nor on its rim)."""
    a, b, c = flat[list(ear)]
    area = _cross(b - a, c - a)
    if area < 0.0 or (strict and area <= limit):
        return False
    others = flat[left]
    others = others[~((others == a) | (others == b) | (others == c)).all(axis=1)]
    margin = -limit if strict else limit
    inside = (
        (_cross(b - a, others - a) > margin)
        & (_cross(c - b, others - b) > margin)
        & (_cross(a - c, others - c) > margin)
    )
    return not bool(inside.any())


def _cross(u: Array, v: Array) -> Array:
    return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]


def _crosses_itself(flat: Array) -> bool:
    """Whether two sides of a polygon in the plane (c, 2) cross at a point within both."""
    ends = np.roll(flat, -1, axis=0)
    along = ends - flat
    scale = float(np.ptp(flat, axis=0).max())
    limit = _FLAT * scale * scale
    for first in range(0, len(flat), _CROSSING_ROWS):
        rows = slice(first, first + _CROSSING_ROWS)
        p, d = flat[rows, None], along[rows, None]
        from_mine = _cross(d, flat[None] - p), _cross(d, ends[None] - p)
        other = along[None]
        from_other = _cross(other, p - flat[None]), _cross(other, p + d - flat[None])
        apart = [
            ((a > limit) & (b < -limit)) | ((a < -limit) & (b > limit))
            for a, b in (from_mine, from_other)
        ]
        if (apart[0] & apart[1]).any():
            return True
    return False


def _unsplit(name: str, number: int, what: str) -> MeshError:
    return MeshError(
        f"{name}: face {number + 1} {what}. Export the mesh as triangles, or repair that face.",
        ErrorCode.MESH_DEGENERATE,
    )
