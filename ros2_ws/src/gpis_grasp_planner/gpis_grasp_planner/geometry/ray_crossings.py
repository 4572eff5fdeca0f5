"""How often a surface goes round a point, and which side of it is outside, told by rays.

The crossings of a ray from a point with a surface, counted with their sign, are the winding
number of a closed surface round the point: 1 inside a well-oriented one and 0 outside, -1 inside
an inverted one, 2 where two bodies overlap. Counted without sign their parity tells inside from
outside whatever way the faces look. A ray that slips through a hole or a crack tells a lie; a
majority of rays seldom does. This is the generalised winding number of A. Jacobson, L. Kavan and
O. Sorkine-Hornung, "Robust inside-outside segmentation using generalized winding numbers", ACM
Trans. Graph. 2013, estimated with a few directions in place of the whole sphere, which costs
microseconds through the tree of boxes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_LEAST_ROUNDS = 4
_MOST_ROUNDS = 32


def crossing_numbers(tree: TriangleTree, points: Array, rays: int = 3) -> NDArray[np.int64]:
    """Winding numbers (n,) at points (n, 3): the median over an odd number of random rays."""
    directions = np.random.default_rng(0).normal(size=(rays, len(points), 3))
    boxes = (tree.triangles, tree.lower, tree.upper, tree.child)
    points = np.ascontiguousarray(points, dtype=float)
    found = np.stack([_signed_crossings(points, d, *boxes) for d in directions])
    return np.asarray(np.median(found, axis=0).astype(np.int64))


def outward_votes(tree: TriangleTree, group: Index, n_groups: int) -> Array:
    """Which way groups of triangles look, (n_groups,): 1 outwards, -1 inwards, 0 undecided.

    Rays start on a group's triangles, drawn by area, to both sides. A ray that crosses the rest
    of the surface an even number of times started outside. A vote is the mean over at least four
    starts, and up to 32 where they do not agree.

    Parameters
    ----------
    tree : TriangleTree
        Of the whole surface.
    group : (m,) int array
        The group of each of the tree's triangles, in the tree's order.
    n_groups : int
    """
    order = np.argsort(group, kind="stable")
    start = np.searchsorted(group[order], np.arange(n_groups + 1))
    t = tree.triangles
    areas = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1)
    return np.asarray(
        _votes(
            start, order, np.cumsum(areas[order]), tree.normals_outward,
            tree.triangles, tree.lower, tree.upper, tree.child,
        )
    )  # fmt: skip


@njit
def _crossings(px, py, pz, dx, dy, dz, skip, triangles, lower, upper, child):  # type: ignore[no-untyped-def]
    """Crossings of a ray with all triangles but one: their number, and the sum of their signs."""
    stack = np.empty(64, dtype=np.int64)
    stack[0] = 0
    top = 1
    count = 0
    total = 0
    ix, iy, iz = 1.0 / dx, 1.0 / dy, 1.0 / dz
    while top > 0:
        top -= 1
        node = stack[top]
        a, b = (lower[node, 0] - px) * ix, (upper[node, 0] - px) * ix
        near, far = min(a, b), max(a, b)
        a, b = (lower[node, 1] - py) * iy, (upper[node, 1] - py) * iy
        near, far = max(near, min(a, b)), min(far, max(a, b))
        a, b = (lower[node, 2] - pz) * iz, (upper[node, 2] - pz) * iz
        near, far = max(near, min(a, b)), min(far, max(a, b))
        # A flat box must not slip away between two roundings.
        if far < 0.0 or near > far + 1e-12 * (abs(far) + abs(near)):
            continue
        if child[node, 0] >= 0:
            stack[top] = child[node, 0]
            stack[top + 1] = child[node, 1]
            top += 2
            continue
        first = -1 - child[node, 0]
        for f in range(first, first + child[node, 1]):
            if f == skip:
                continue
            t = triangles[f]
            ax, ay, az = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1], t[1, 2] - t[0, 2]
            bx, by, bz = t[2, 0] - t[0, 0], t[2, 1] - t[0, 1], t[2, 2] - t[0, 2]
            hx, hy, hz = dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx
            determinant = ax * hx + ay * hy + az * hz
            if determinant == 0.0:
                continue
            sx, sy, sz = px - t[0, 0], py - t[0, 1], pz - t[0, 2]
            u = (sx * hx + sy * hy + sz * hz) / determinant
            if u < 0.0 or u > 1.0:
                continue
            qx, qy, qz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
            v = (dx * qx + dy * qy + dz * qz) / determinant
            if v < 0.0 or u + v > 1.0:
                continue
            if (bx * qx + by * qy + bz * qz) / determinant > 0.0:
                count += 1
                # The determinant is -direction . normal: a ray that leaves counts +1.
                total += -1 if determinant > 0.0 else 1
    return count, total


@njit
def _signed_crossings(points, directions, triangles, lower, upper, child):  # type: ignore[no-untyped-def]
    out = np.empty(points.shape[0], dtype=np.int64)
    for n in range(points.shape[0]):
        _, out[n] = _crossings(
            points[n, 0], points[n, 1], points[n, 2],
            directions[n, 0], directions[n, 1], directions[n, 2],
            -1, triangles, lower, upper, child,
        )  # fmt: skip
    return out


@njit
def _uniform(state):  # type: ignore[no-untyped-def]
    """The next number of [0, 1) of a linear congruential generator; 31 bits."""
    state[0] = (1103515245 * state[0] + 12345) % 2147483648
    return state[0] / 2147483648.0


@njit
def _votes(start, order, cumulated, normals, triangles, lower, upper, child):  # type: ignore[no-untyped-def]
    n_groups = len(start) - 1
    votes = np.zeros(n_groups)
    state = np.ones(1, dtype=np.int64)
    for g in range(n_groups):
        first, last = start[g], start[g + 1]
        if first == last:
            continue
        before = cumulated[first - 1] if first > 0 else 0.0
        total = 0.0
        rounds = 0
        while rounds < _MOST_ROUNDS:
            at = before + _uniform(state) * (cumulated[last - 1] - before)
            f = order[min(first + np.searchsorted(cumulated[first:last], at), last - 1)]
            root = np.sqrt(_uniform(state))
            v = _uniform(state)
            a, b, c = 1.0 - root, root * (1.0 - v), root * v
            t = triangles[f]
            px = a * t[0, 0] + b * t[1, 0] + c * t[2, 0]
            py = a * t[0, 1] + b * t[1, 1] + c * t[2, 1]
            pz = a * t[0, 2] + b * t[1, 2] + c * t[2, 2]
            while True:  # a direction of the half space in front, not along the face
                dx = 2.0 * _uniform(state) - 1.0
                dy = 2.0 * _uniform(state) - 1.0
                dz = 2.0 * _uniform(state) - 1.0
                length = np.sqrt(dx * dx + dy * dy + dz * dz)
                rise = dx * normals[f, 0] + dy * normals[f, 1] + dz * normals[f, 2]
                if 0.1 < length <= 1.0 and abs(rise) > 0.15 * length and dx * dy * dz != 0.0:
                    break
            if rise < 0.0:
                dx, dy, dz = -dx, -dy, -dz
            front, _ = _crossings(px, py, pz, dx, dy, dz, f, triangles, lower, upper, child)
            back, _ = _crossings(px, py, pz, -dx, -dy, -dz, f, triangles, lower, upper, child)
            total += back % 2 - front % 2
            rounds += 1
            if rounds >= _LEAST_ROUNDS and abs(total) == rounds:
                break
        votes[g] = total / rounds
    return votes
