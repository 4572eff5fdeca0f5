"""Distance between convex polytopes, triangles included: GJK, compiled.

A polytope is given by its vertices, already in the mesh's frame. The distance algorithm is
that of Gilbert, Johnson and Keerthi (1988): the point of the Minkowski difference nearest to the
origin, approached through simplices of support points. It is exact up to rounding for separated
bodies and reports 0 for overlapping ones; penetration depths are not needed by the planner,
which stops before contact.

Some 1 us for a polytope of 60 to 150 vertices and a triangle, on one core. Most of it goes into
finding the support points, so that the polytope's coordinates lie in columns, which a processor
takes several at a time. Nothing is allocated here and no view is made: both would cost more than
the arithmetic of a query that ends early.
"""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.lanes import LANES, filled, lowest_along

_RELATIVE = 1e-10
_ITERATIONS = 40
# Rows of the scratch array: the simplex, its points on both bodies, the barycentric coordinates,
# and what the nearest point of a tetrahedron is found with.
_SIMPLEX, _ON_SELF, _ON_OTHER, _BARY, _FACE, _LOCAL, _KEPT = 0, 4, 8, 12, 13, 16, 17
_ROWS = 18


@njit(allocates=False)
def _nearest_in_simplex(s, first, n, bary):  # type: ignore[no-untyped-def]
    """Barycentric coordinates of the point of a simplex nearest to the origin, into s[bary].

    Its n = 1..3 points are the rows of s from `first` on.
    """
    for i in range(4):
        s[bary, i] = 0.0
    if n == 1:
        s[bary, 0] = 1.0
        return
    if n == 2:
        num = 0.0
        den = 0.0
        for c in range(3):
            e = s[first + 1, c] - s[first, c]
            num -= s[first, c] * e
            den += e * e
        t = 0.0 if den <= 0.0 else min(max(num / den, 0.0), 1.0)
        s[bary, 0] = 1.0 - t
        s[bary, 1] = t
        return
    d1 = d2 = d3 = d4 = d5 = d6 = 0.0
    for c in range(3):
        ab = s[first + 1, c] - s[first, c]
        ac = s[first + 2, c] - s[first, c]
        d1 -= ab * s[first, c]
        d2 -= ac * s[first, c]
        d3 -= ab * s[first + 1, c]
        d4 -= ac * s[first + 1, c]
        d5 -= ab * s[first + 2, c]
        d6 -= ac * s[first + 2, c]
    if d1 <= 0.0 and d2 <= 0.0:
        s[bary, 0] = 1.0
        return
    if d3 >= 0.0 and d4 <= d3:
        s[bary, 1] = 1.0
        return
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        t = d1 / (d1 - d3)
        s[bary, 0] = 1.0 - t
        s[bary, 1] = t
        return
    if d6 >= 0.0 and d5 <= d6:
        s[bary, 2] = 1.0
        return
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        t = d2 / (d2 - d6)
        s[bary, 0] = 1.0 - t
        s[bary, 2] = t
        return
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and (d4 - d3) >= 0.0 and (d5 - d6) >= 0.0:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        s[bary, 1] = 1.0 - t
        s[bary, 2] = t
        return
    total = va + vb + vc
    s[bary, 1] = vb / total
    s[bary, 2] = vc / total
    s[bary, 0] = 1.0 - s[bary, 1] - s[bary, 2]


@njit(allocates=False)
def _nearest_in_tetrahedron(s):  # type: ignore[no-untyped-def]
    """As above for four points; True where the origin is inside the tetrahedron."""
    best = np.inf
    outside_any = False
    for i in range(4):
        s[_KEPT, i] = 0.0
    for skip in range(4):
        k = _FACE
        for i in range(4):
            if i != skip:
                for c in range(3):
                    s[k, c] = s[_SIMPLEX + i, c]
                k += 1
        # which side of the face's plane: the origin against the left-out point
        x, y, z = s[_FACE, 0], s[_FACE, 1], s[_FACE, 2]
        ax, ay, az = s[_FACE + 1, 0] - x, s[_FACE + 1, 1] - y, s[_FACE + 1, 2] - z
        bx, by, bz = s[_FACE + 2, 0] - x, s[_FACE + 2, 1] - y, s[_FACE + 2, 2] - z
        nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        to_origin = -(nx * x + ny * y + nz * z)
        to_point = (
            nx * (s[_SIMPLEX + skip, 0] - x)
            + ny * (s[_SIMPLEX + skip, 1] - y)
            + nz * (s[_SIMPLEX + skip, 2] - z)
        )
        if to_origin * to_point > 0.0:
            continue
        outside_any = True
        _nearest_in_simplex(s, _FACE, 3, _LOCAL)
        d2 = 0.0
        for c in range(3):
            x = (
                s[_LOCAL, 0] * s[_FACE, c]
                + s[_LOCAL, 1] * s[_FACE + 1, c]
                + s[_LOCAL, 2] * s[_FACE + 2, c]
            )
            d2 += x * x
        if d2 < best:
            best = d2
            k = 0
            for i in range(4):
                if i == skip:
                    s[_KEPT, i] = 0.0
                else:
                    s[_KEPT, i] = s[_LOCAL, k]
                    k += 1
    for i in range(4):
        s[_BARY, i] = s[_KEPT, i]
    return not outside_any


@njit
def scratch_of(n):  # type: ignore[no-untyped-def]
    """Arrays for :func:`columns_distance` and polytopes of up to n vertices.

    Returns (columns (3, N), scratch).
    """
    return np.empty((3, n + LANES)), np.empty((_ROWS, 4))


@njit(allocates=False)
def columns_distance(columns, n_self, other, n_other, limit, direction, p_self, p_other, s):  # type: ignore[no-untyped-def]
    """As :func:`polytope_distance`, of a polytope whose coordinates are rows of `columns`.

    `columns` (3, N) and the scratch array `s` are of :func:`scratch_of`; the first `n_self`
    columns count, `filled` to the lanes, and the first `n_other` rows of `other`. Where it stops at
    `limit`, `p_self` is the direction along which the bodies were seen to be that far apart.
    """
    vx, vy, vz = direction[0], direction[1], direction[2]
    if vx * vx + vy * vy + vz * vz < 1e-24:
        vx, vy, vz = 0.0, 0.0, 1.0
    n = 0
    distance2 = np.inf
    for _ in range(_ITERATIONS):
        # support of the difference polytope - other in direction -v
        self_index, best = lowest_along(columns, n_self, (vx, vy, vz))
        best_other = -np.inf
        other_index = 0
        for i in range(n_other):
            h = other[i, 0] * vx + other[i, 1] * vy + other[i, 2] * vz
            if h > best_other:
                best_other = h
                other_index = i
        gap = best - best_other
        v2 = vx * vx + vy * vy + vz * vz
        if gap > 0.0 and gap * gap > limit * limit * v2:
            p_self[0], p_self[1], p_self[2] = vx, vy, vz
            return gap / np.sqrt(v2)
        if n > 0:
            if v2 - gap <= _RELATIVE * v2:
                break
            repeated = False
            for k in range(n):
                same = True
                for c in range(3):
                    if (
                        s[_ON_SELF + k, c] != columns[c, self_index]
                        or s[_ON_OTHER + k, c] != other[other_index, c]
                    ):
                        same = False
                if same:
                    repeated = True
            if repeated:
                break
        for c in range(3):
            s[_ON_SELF + n, c] = columns[c, self_index]
            s[_ON_OTHER + n, c] = other[other_index, c]
            s[_SIMPLEX + n, c] = s[_ON_SELF + n, c] - s[_ON_OTHER + n, c]
        n += 1
        if n == 4:
            if _nearest_in_tetrahedron(s):
                return 0.0
        else:
            _nearest_in_simplex(s, _SIMPLEX, n, _BARY)
        kept = 0
        for k in range(n):
            if s[_BARY, k] > 0.0:
                if kept != k:
                    for c in range(3):
                        s[_SIMPLEX + kept, c] = s[_SIMPLEX + k, c]
                        s[_ON_SELF + kept, c] = s[_ON_SELF + k, c]
                        s[_ON_OTHER + kept, c] = s[_ON_OTHER + k, c]
                    s[_BARY, kept] = s[_BARY, k]
                kept += 1
        n = kept
        vx = vy = vz = 0.0
        for k in range(n):
            vx += s[_BARY, k] * s[_SIMPLEX + k, 0]
            vy += s[_BARY, k] * s[_SIMPLEX + k, 1]
            vz += s[_BARY, k] * s[_SIMPLEX + k, 2]
        new2 = vx * vx + vy * vy + vz * vz
        if new2 < 1e-22:
            return 0.0
        if new2 >= distance2:
            break
        distance2 = new2
    for c in range(3):
        p_self[c] = 0.0
        p_other[c] = 0.0
        for k in range(n):
            p_self[c] += s[_BARY, k] * s[_ON_SELF + k, c]
            p_other[c] += s[_BARY, k] * s[_ON_OTHER + k, c]
    direction[0], direction[1], direction[2] = vx, vy, vz
    return np.sqrt(vx * vx + vy * vy + vz * vz)


@njit
def polytope_distance(vertices, other, limit, direction, p_self, p_other):  # type: ignore[no-untyped-def]
    """Distance of a convex polytope from another one, such as a triangle.

    Parameters
    ----------
    vertices : (n, 3) array
    other : (m, 3) array
    limit : float
        Stop early, returning a lower bound above it, once the distance is known to exceed it.
    direction : (3,) array, in and out
        A guess of the direction from the other to the polytope; on return the vector between the
        nearest points (polytope minus other).
    p_self, p_other : (3,) arrays, out
        The nearest points.

    Returns
    -------
    float
        The distance [m]; 0 where the bodies touch or overlap.
    """
    n = vertices.shape[0]
    columns, scratch = scratch_of(n)
    for i in range(n):
        for c in range(3):
            columns[c, i] = vertices[i, c]
    full = filled(columns, n)
    return columns_distance(
        columns, full, other, other.shape[0], limit, direction, p_self, p_other, scratch
    )
