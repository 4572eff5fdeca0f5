"""Epsilon of a hull of forces, in three dimensions, exact and quick (compiled, some 10 us).

The hull is grown from the inside: of a polytope of some of the points, the facet nearest to the
origin (by signed offset, so that a facet that has the origin outside comes first) is pushed out
to the farthest point along its normal. Where no point lies beyond it, it is a facet of the whole
hull, and none of that hull lies nearer to the origin. Parts of the hull that do not matter are
never built.
"""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.compiled import njit

_FACETS = 512
_ROUNDS = 200
_TOLERANCE = 1e-9


@njit
def _set_facet(P, facets, normals, offsets, row, a, b, c):  # type: ignore[no-untyped-def]
    """Facet through points a, b, c, counter-clockwise from outside; False if it has no area."""
    ux, uy, uz = P[b, 0] - P[a, 0], P[b, 1] - P[a, 1], P[b, 2] - P[a, 2]
    vx, vy, vz = P[c, 0] - P[a, 0], P[c, 1] - P[a, 1], P[c, 2] - P[a, 2]
    nx = uy * vz - uz * vy
    ny = uz * vx - ux * vz
    nz = ux * vy - uy * vx
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    facets[row, 0], facets[row, 1], facets[row, 2] = a, b, c
    if length < 1e-14:
        normals[row, :] = 0.0
        offsets[row] = np.inf
        return False
    normals[row, 0], normals[row, 1], normals[row, 2] = nx / length, ny / length, nz / length
    offsets[row] = (nx * P[a, 0] + ny * P[a, 1] + nz * P[a, 2]) / length
    return True


@njit
def _farthest(P, n, x, y, z):  # type: ignore[no-untyped-def]
    best = -np.inf
    index = 0
    for i in range(n):
        h = P[i, 0] * x + P[i, 1] * y + P[i, 2] * z
        if h > best:
            best = h
            index = i
    return index, best


@njit
def _first_tetrahedron(P, n, corners):  # type: ignore[no-untyped-def]
    """Four points of good volume into corners, positively oriented; False if all are flat."""
    a, _ = _farthest(P, n, 1.0, 0.0, 0.0)
    b, best = a, 0.0
    for i in range(n):
        d = (P[i, 0] - P[a, 0]) ** 2 + (P[i, 1] - P[a, 1]) ** 2 + (P[i, 2] - P[a, 2]) ** 2
        if d > best:
            b, best = i, d
    if best < 1e-16:
        return False
    ux, uy, uz = P[b, 0] - P[a, 0], P[b, 1] - P[a, 1], P[b, 2] - P[a, 2]
    c, best = a, 0.0
    nx = ny = nz = 0.0
    for i in range(n):
        vx, vy, vz = P[i, 0] - P[a, 0], P[i, 1] - P[a, 1], P[i, 2] - P[a, 2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        area = x * x + y * y + z * z
        if area > best:
            c, best = i, area
            nx, ny, nz = x, y, z
    if best < 1e-16:
        return False
    d, best = a, 0.0
    for i in range(n):
        volume = nx * (P[i, 0] - P[a, 0]) + ny * (P[i, 1] - P[a, 1]) + nz * (P[i, 2] - P[a, 2])
        if abs(volume) > abs(best):
            d, best = i, volume
    if abs(best) < 1e-12:
        return False
    # The facet a, b, c looks away from d.
    corners[0], corners[3] = a, d
    corners[1], corners[2] = (c, b) if best > 0.0 else (b, c)
    return True


@njit
def _push_out(P, facets, normals, offsets, count, p, edges):  # type: ignore[no-untyped-def]
    """Replace the facets that see point p by the cone from their horizon; the new count or -1."""
    n_edges = 0
    kept = 0
    for f in range(count):
        height = (
            normals[f, 0] * P[p, 0] + normals[f, 1] * P[p, 1] + normals[f, 2] * P[p, 2] - offsets[f]
        )
        if height <= _TOLERANCE:
            facets[kept] = facets[f]
            normals[kept] = normals[f]
            offsets[kept] = offsets[f]
            kept += 1
            continue
        for k in range(3):
            u, v = facets[f, k], facets[f, (k + 1) % 3]
            # An edge seen from both sides lies inside the part that goes.
            shared = -1
            for e in range(n_edges):
                if edges[e, 0] == v and edges[e, 1] == u:
                    shared = e
                    break
            if shared >= 0:
                n_edges -= 1
                edges[shared] = edges[n_edges]
            elif n_edges < edges.shape[0]:
                edges[n_edges, 0], edges[n_edges, 1] = u, v
                n_edges += 1
    if kept + n_edges > facets.shape[0]:
        return -1
    for e in range(n_edges):
        _set_facet(P, facets, normals, offsets, kept, edges[e, 0], edges[e, 1], p)
        kept += 1
    return kept


@njit
def force_epsilon(P, n):  # type: ignore[no-untyped-def]
    """Radius of the largest ball about the origin in the hull of points P[:n], (m, 3).

    -1 where the origin is not strictly inside.
    """
    if n < 4:
        return -1.0
    for axis in range(3):
        high = low = 0.0
        for i in range(n):
            high = max(high, P[i, axis])
            low = min(low, P[i, axis])
        if high <= 0.0 or low >= 0.0:
            return -1.0
    corners = np.empty(4, dtype=np.int64)
    if not _first_tetrahedron(P, n, corners):
        return -1.0
    facets = np.empty((_FACETS, 3), dtype=np.int64)
    normals = np.empty((_FACETS, 3))
    offsets = np.empty(_FACETS)
    edges = np.empty((_FACETS, 2), dtype=np.int64)
    a, b, c, d = corners[0], corners[1], corners[2], corners[3]
    _set_facet(P, facets, normals, offsets, 0, a, b, c)
    _set_facet(P, facets, normals, offsets, 1, a, c, d)
    _set_facet(P, facets, normals, offsets, 2, c, b, d)
    _set_facet(P, facets, normals, offsets, 3, b, a, d)
    count = 4
    nearest = -1.0
    for _ in range(_ROUNDS):
        f = int(np.argmin(offsets[:count]))
        nearest = offsets[f]
        p, height = _farthest(P, n, normals[f, 0], normals[f, 1], normals[f, 2])
        if height <= nearest + 10.0 * _TOLERANCE:
            break
        count = _push_out(P, facets, normals, offsets, count, p, edges)
        if count < 0:
            break
    return nearest if nearest > 0.0 else -1.0
