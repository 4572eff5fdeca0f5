"""Distances and near pairs of a convex polytope and a mesh: GJK pruned by the triangle tree.

The tree is pruned by the polytope's own box and by the separating plane of the nearest pair found
so far; 5 to 100 us a query on one core, by how closely the triangles lie around the contact. Of a
fine mesh the plane is compared with the nodes' slabs as well, which are as thin as the surface, and
so is a second one: what kept the last triangle off mostly keeps its neighbours off.
"""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.geometry.gjk import columns_distance, scratch_of
from gpis_grasp_planner.geometry.triangle_tree import near_point, nearest_point
from gpis_grasp_planner.lanes import filled, lowest_along

_ROUNDS = 4
_NEARER = 0.999  # share of a distance that is clearly less
_FIRST_APART = 0.0005  # of pairs that are thinned out [m]


@njit(allocates=False)
def _box_gap(R, t, box_low, box_high, lower, upper, node):  # type: ignore[no-untyped-def]
    """Lower bound of the distance between a link's box (in its frame) and a node's box."""
    k = np.uint64(node)
    cx = 0.5 * (lower[k, 0] + upper[k, 0]) - t[0]
    cy = 0.5 * (lower[k, 1] + upper[k, 1]) - t[1]
    cz = 0.5 * (lower[k, 2] + upper[k, 2]) - t[2]
    ex = 0.5 * (upper[k, 0] - lower[k, 0])
    ey = 0.5 * (upper[k, 1] - lower[k, 1])
    ez = 0.5 * (upper[k, 2] - lower[k, 2])
    total = 0.0
    for a in range(3):
        middle = R[0, a] * cx + R[1, a] * cy + R[2, a] * cz
        reach = abs(R[0, a]) * ex + abs(R[1, a]) * ey + abs(R[2, a]) * ez
        below = box_low[a] - (middle + reach)
        above = (middle - reach) - box_high[a]
        gap = below if below > above else above
        if gap > 0.0:
            total += gap * gap
    return np.sqrt(total)


@njit(allocates=False)
def _take_triangle(triangles, f, triangle):  # type: ignore[no-untyped-def]
    for k in range(3):
        for c in range(3):
            triangle[k, c] = triangles[f, k, c]


@njit(allocates=False)
def _highest(t, nx, ny, nz):  # type: ignore[no-untyped-def]
    return max(
        nx * t[0, 0] + ny * t[0, 1] + nz * t[0, 2],
        max(
            nx * t[1, 0] + ny * t[1, 1] + nz * t[1, 2],
            nx * t[2, 0] + ny * t[2, 1] + nz * t[2, 2],
        ),
    )


@njit(allocates=False)
def _highest_of_box(lower, upper, node, nx, ny, nz):  # type: ignore[no-untyped-def]
    k = np.uint64(node)
    return (
        nx * (upper[k, 0] if nx > 0 else lower[k, 0])
        + ny * (upper[k, 1] if ny > 0 else lower[k, 1])
        + nz * (upper[k, 2] if nz > 0 else lower[k, 2])
    )


@njit(allocates=False)
def _farthest(lower, upper, slabs, node, nx, ny, nz):  # type: ignore[no-untyped-def]
    """Upper bound of a node's height along a direction: of its box, or of its slab in the box."""
    by_box = _highest_of_box(lower, upper, node, nx, ny, nz)
    if slabs.shape[0] == 0:
        return by_box
    k = np.uint64(node)
    sx, sy, sz = slabs[k, 0], slabs[k, 1], slabs[k, 2]
    along = nx * sx + ny * sy + nz * sz
    by_slab = along * (slabs[k, 4] if along > 0 else slabs[k, 3])
    nx, ny, nz = nx - along * sx, ny - along * sy, nz - along * sz
    by_slab += _highest_of_box(lower, upper, node, nx, ny, nz)
    return min(by_box, by_slab)


@njit(allocates=False)
def _support_plane(columns, n, direction, out):  # type: ignore[no-untyped-def]
    """A unit normal along `direction`, and the height that all of the polytope has: out (4,)."""
    length = np.sqrt(direction[0] ** 2 + direction[1] ** 2 + direction[2] ** 2)
    if length > 0.0:
        x, y, z = direction[0] / length, direction[1] / length, direction[2] / length
        out[0], out[1], out[2] = x, y, z
        out[3] = lowest_along(columns, n, (x, y, z))[1]


@njit(allocates=False)
def _keeps_node_off(second, lower, upper, slabs, node, reach):  # type: ignore[no-untyped-def]
    """Whether a plane that the polytope is behind keeps a node's slab farther off than `reach`."""
    if slabs.shape[0] == 0:
        return False
    return (
        second[3] - _farthest(lower, upper, slabs, node, second[0], second[1], second[2]) >= reach
    )


@njit(allocates=False)
def _keeps_off(second, slabs, triangle, reach):  # type: ignore[no-untyped-def]
    """As `_keeps_node_off`, of a triangle."""
    if slabs.shape[0] == 0:
        return False
    return second[3] - _highest(triangle, second[0], second[1], second[2]) >= reach


@njit(allocates=False)
def _columns_of(vertices, columns):  # type: ignore[no-untyped-def]
    """The vertices' coordinates as rows, `filled`; returns how many."""
    for i in range(vertices.shape[0]):
        for c in range(3):
            columns[c, i] = vertices[i, c]
    return filled(columns, vertices.shape[0])


@njit
def polytope_mesh(
    vertices, R, t, box_low, box_high, limit, seed, triangles, lower, upper, child, slabs
):  # type: ignore[no-untyped-def]
    """Distance of a convex polytope from a mesh, or `limit` where it is at least that.

    Parameters
    ----------
    vertices : (n, 3) array
        The polytope in the mesh's frame.
    R, t : (3, 3), (3,) arrays
        Pose of the polytope's own frame in the mesh's frame.
    box_low, box_high : (3,) arrays
        The polytope's box in its own frame.
    limit : float [m]
    seed : int
        A triangle to start with, such as the one that is near, or -1. A good one prunes most.
    triangles, lower, upper, child, slabs
        Arrays of the mesh's `TriangleTree`.
    """
    stack = np.empty(64, dtype=np.int64)
    gap_of = np.empty(64)  # of the boxes on the stack
    stack[0] = 0
    gap_of[0] = _box_gap(R, t, box_low, box_high, lower, upper, 0)
    top = 1
    best = limit
    direction = np.zeros(3)
    p = np.empty(3)
    q = np.empty(3)
    triangle = np.empty((3, 3))
    columns, scratch = scratch_of(vertices.shape[0])
    n = _columns_of(vertices, columns)
    if seed >= 0:
        _take_triangle(triangles, seed, triangle)
        d = columns_distance(columns, n, triangle, 3, 1e30, direction, p, q, scratch)
        if d <= 0.0:
            return 0.0
    # separating plane of the best pair so far: all of the polytope has n.x >= plane
    nx = ny = nz = 0.0
    plane = 0.0
    have_plane = False
    second = np.zeros(4)  # the plane that kept the last triangle off
    second[3] = -np.inf
    share = 1.0  # what must be nearer than this share of the best is looked at
    if seed >= 0:
        best = min(best, d)
        nx, ny, nz = direction[0] / d, direction[1] / d, direction[2] / d
        plane = lowest_along(columns, n, (nx, ny, nz))[1]
        have_plane = True
        if slabs.shape[0] > 0:
            # From the polytope's point to the mesh's nearest and back: hundreds of small triangles
            # tie for their boxes, and only a near pair's plane tells them apart.
            share = 1.0 - 1e-9  # of a flat face all triangles are as near: one is enough
            for _ in range(_ROUNDS):
                _, f, _ = nearest_point(p[0], p[1], p[2], best, triangles, lower, upper, child, q)
                if f < 0:
                    break
                _take_triangle(triangles, f, triangle)
                d = columns_distance(columns, n, triangle, 3, best, direction, p, q, scratch)
                if d <= 0.0:
                    return 0.0
                if d >= best:
                    break
                best = d
                nx, ny, nz = direction[0] / d, direction[1] / d, direction[2] / d
                plane = lowest_along(columns, n, (nx, ny, nz))[1]
    while top > 0:
        top -= 1
        node = stack[top]
        if gap_of[top] >= share * best:
            continue
        if have_plane:
            highest = _farthest(lower, upper, slabs, node, nx, ny, nz)
            if plane - highest >= share * best:
                continue
        if _keeps_node_off(second, lower, upper, slabs, node, share * best):
            continue
        if child[node, 0] >= 0:
            a, b = child[node, 0], child[node, 1]
            gap_a = _box_gap(R, t, box_low, box_high, lower, upper, a)
            gap_b = _box_gap(R, t, box_low, box_high, lower, upper, b)
            if gap_a < gap_b:
                a, b = b, a
                gap_a, gap_b = gap_b, gap_a
            if gap_a < best:
                stack[top] = a
                gap_of[top] = gap_a
                top += 1
            if gap_b < best:
                stack[top] = b
                gap_of[top] = gap_b
                top += 1
            continue
        first = -1 - child[node, 0]
        for f in range(first, first + child[node, 1]):
            _take_triangle(triangles, f, triangle)
            if have_plane and plane - _highest(triangle, nx, ny, nz) >= share * best:
                continue
            if _keeps_off(second, slabs, triangle, share * best):
                continue
            d = columns_distance(columns, n, triangle, 3, best, direction, p, q, scratch)
            if d <= 0.0:
                return 0.0
            if d > best and slabs.shape[0] > 0:
                _support_plane(columns, n, p, second)
            if d < best:
                best = d
                nx, ny, nz = direction[0] / d, direction[1] / d, direction[2] / d
                plane = lowest_along(columns, n, (nx, ny, nz))[1]
                have_plane = True
    return best


@njit
def near_pairs(
    vertices, R, t, box_low, box_high, limit, triangles, lower, upper, child, slabs, p_self, p_other
):  # type: ignore[no-untyped-def]
    """Nearest points of a polytope with the triangles nearer than `limit`, as contacts of bodies.

    A triangle has none where its pair's point of the polytope has a nearer point of the mesh: it
    is a pair of features then. Fills rows of `p_self` and `p_other` (k, 3) and returns the number.
    Where there are more pairs than rows, those are kept that lie apart on the mesh, so that they
    are of the whole contact and not of its first corner. Other parameters as for `polytope_mesh`.
    """
    stack = np.empty(64, dtype=np.int64)
    stack[0] = 0
    top = 1
    count = 0
    direction = np.zeros(3)
    p = np.empty(3)
    q = np.empty(3)
    triangle = np.empty((3, 3))
    columns, scratch = scratch_of(vertices.shape[0])
    n = _columns_of(vertices, columns)
    # the separating plane of the nearest pair so far; what lies `limit` behind it is too far
    nx = ny = nz = 0.0
    plane = -np.inf
    nearest = np.inf
    nearest_row = 0
    second = np.zeros(4)
    second[3] = -np.inf
    other = np.full(3, np.inf)
    apart = 0.0  # until the rows are full all pairs are kept
    while top > 0:
        top -= 1
        node = stack[top]
        if apart > 0.0 and _covers(p_other, count, apart, lower[node], upper[node]):
            continue
        if nearest < limit:
            highest = _farthest(lower, upper, slabs, node, nx, ny, nz)
            if plane - highest >= limit:
                continue
        if _keeps_node_off(second, lower, upper, slabs, node, limit):
            continue
        if _box_gap(R, t, box_low, box_high, lower, upper, node) >= limit:
            continue
        if child[node, 0] >= 0:
            stack[top] = child[node, 0]
            stack[top + 1] = child[node, 1]
            top += 2
            continue
        first = -1 - child[node, 0]
        for f in range(first, first + child[node, 1]):
            _take_triangle(triangles, f, triangle)
            if nearest < limit and plane - _highest(triangle, nx, ny, nz) >= limit:
                continue
            if apart > 0.0 and _covers_triangle(p_other, count, apart, triangle):
                continue
            if _keeps_off(second, slabs, triangle, limit):
                continue
            d = columns_distance(columns, n, triangle, 3, limit, direction, p, q, scratch)
            if d > limit and slabs.shape[0] > 0:
                _support_plane(columns, n, p, second)
            if 0.0 < d < limit:
                if apart > 0.0 and d >= nearest and _covers(p_other, count, apart, q, q):
                    continue
                # The mesh's point that was nearer to the last pair often is to this one.
                if _is_nearer(other, p, d):
                    continue
                enough = d * _NEARER - 1e-9
                near_point(p[0], p[1], p[2], d, enough, triangles, lower, upper, child, other)
                if _is_nearer(other, p, d):
                    continue
                for c in range(3):
                    p_self[count, c] = p[c]
                    p_other[count, c] = q[c]
                count += 1
                if d < nearest:
                    nearest_row = count - 1
                    nearest = d
                    nx, ny, nz = direction[0] / d, direction[1] / d, direction[2] / d
                    plane = lowest_along(columns, n, (nx, ny, nz))[1]
            if count == p_self.shape[0]:
                apart, count = _thinned(p_self, p_other, nearest_row, apart)
                nearest_row = 0
    return count


@njit(allocates=False)
def _is_nearer(point, p, d):  # type: ignore[no-untyped-def]
    """Whether a point of the mesh is nearer to `p` than `d`, clearly."""
    total = 0.0
    for c in range(3):
        total += (point[c] - p[c]) ** 2
    return np.sqrt(total) < d * _NEARER - 1e-9


@njit(allocates=False)
def _covers(points, n, apart, low, high):  # type: ignore[no-untyped-def]
    """Whether one of n points is nearer than `apart` to all of a box."""
    for i in range(n):
        total = 0.0
        for c in range(3):
            reach = max(points[i, c] - low[c], high[c] - points[i, c])
            total += reach * reach
        if total < apart * apart:
            return True
    return False


@njit(allocates=False)
def _covers_triangle(points, n, apart, triangle):  # type: ignore[no-untyped-def]
    """Whether one of n points is nearer than `apart` to all of a triangle."""
    for i in range(n):
        near = True
        for k in range(3):
            total = 0.0
            for c in range(3):
                total += (points[i, c] - triangle[k, c]) ** 2
            near = near and total < apart * apart
        if near:
            return True
    return False


@njit(allocates=False)
def _thinned(p_self, p_other, first, apart):  # type: ignore[no-untyped-def]
    """Keep at most half of full rows: `first`, and what lies apart; (how far apart, how many)."""
    for c in range(3):
        p_self[0, c], p_self[first, c] = p_self[first, c], p_self[0, c]
        p_other[0, c], p_other[first, c] = p_other[first, c], p_other[0, c]
    count = p_self.shape[0]
    while count > p_self.shape[0] // 2:
        apart = max(2.0 * apart, _FIRST_APART)
        kept = 1
        for i in range(1, count):
            if _covers(p_other, kept, apart, p_other[i], p_other[i]):
                continue
            for c in range(3):
                p_self[kept, c] = p_self[i, c]
                p_other[kept, c] = p_other[i, c]
            kept += 1
        count = kept
    return apart, count
