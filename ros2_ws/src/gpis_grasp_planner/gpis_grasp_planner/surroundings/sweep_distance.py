"""Distances of moving convex pieces from bodies at rest, compiled.

A piece that moves straight from one pose to another sweeps the hull of its vertices at both
ends (exactly where it does not turn), and GJK needs no more of a hull than its vertices. So a
sweep costs twice a pose, and there are no steps between which something thin could be missed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.geometry.convex_distance import polytope_mesh
from gpis_grasp_planner.geometry.gjk import polytope_distance
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.grasp.hand_motion import HandPieces

Array = NDArray[np.float64]


def distances_from_tree(
    tree: TriangleTree,
    pieces: HandPieces,
    which: NDArray[np.int64],
    T_0: Array,
    T_1: Array,
    limit: Array,
) -> Array:
    """Distances (M,) of sweeps of a hand's pieces from a mesh's surface; 0 where they meet.

    Parameters
    ----------
    tree : TriangleTree
        Of the mesh.
    pieces : HandPieces
    which : (M,) int array
        The piece of each sweep.
    T_0, T_1 : (M, 4, 4) arrays
        Poses of its link in the mesh's frame, at both ends.
    limit : (M,) array [m]
        Of what is farther away, at least this is said.
    """
    first, last = np.ascontiguousarray(T_0), np.ascontiguousarray(T_1)
    distance = np.empty(len(which))
    sweeps_to_mesh(
        pieces.vertices, pieces.start, which, first, last, limit,
        tree.triangles, tree.lower, tree.upper, tree.child, tree.slabs, distance,
    )  # fmt: skip
    return distance


@njit
def _sweep(vertices, first, last, T_0, T_1, out):  # type: ignore[no-untyped-def]
    """Vertices [first, last) of a piece at both poses, into out; returns how many."""
    n = last - first
    for i in range(n):
        p = vertices[first + i]
        for a in range(3):
            out[i, a] = T_0[a, 3] + T_0[a, 0] * p[0] + T_0[a, 1] * p[1] + T_0[a, 2] * p[2]
            out[n + i, a] = T_1[a, 3] + T_1[a, 0] * p[0] + T_1[a, 1] * p[1] + T_1[a, 2] * p[2]
    return 2 * n


@njit
def sweeps_to_polytope(vertices, start, piece, T_0, T_1, limit, other, distance):  # type: ignore[no-untyped-def]
    """Distances of M sweeps from a solid convex polytope.

    Parameters
    ----------
    vertices, start
        Of `HandPieces`.
    piece : (M,) int array
    T_0, T_1 : (M, 4, 4) arrays
        Poses of the pieces' links at both ends, in the frame of `other`.
    limit : (M,) array [m]
    other : (m, 3) array
    distance : (M,) array, out
        0 where they overlap; a lower bound where it is more than `limit`.
    """
    work = np.empty((2 * np.max(start[1:] - start[:-1]), 3))
    direction = np.empty(3)
    p = np.empty(3)
    q = np.empty(3)
    for k in range(piece.shape[0]):
        first, last = start[piece[k]], start[piece[k] + 1]
        n = _sweep(vertices, first, last, T_0[k], T_1[k], work)
        for a in range(3):
            direction[a] = np.mean(work[:n, a]) - np.mean(other[:, a])
        distance[k] = polytope_distance(work[:n], other, limit[k], direction, p, q)


@njit
def sweeps_to_mesh(  # type: ignore[no-untyped-def]
    vertices, start, piece, T_0, T_1, limit, triangles, lower, upper, child, slabs, distance
):
    """Distances of M sweeps from a mesh's surface, at most `limit`; see `sweeps_to_polytope`.

    `triangles` to `slabs` are the arrays of the mesh's `TriangleTree`.
    """
    work = np.empty((2 * np.max(start[1:] - start[:-1]), 3))
    R = np.empty((3, 3))
    t = np.zeros(3)
    low = np.empty(3)
    high = np.empty(3)
    no_seed = np.int64(-1)  # no literal, which would be a type of its own
    for k in range(piece.shape[0]):
        first, last = start[piece[k]], start[piece[k] + 1]
        n = _sweep(vertices, first, last, T_0[k], T_1[k], work)
        # the sweep's box in the link's axes prunes better than one in the mesh's
        for a in range(3):
            low[a] = np.inf
            high[a] = -np.inf
            for b in range(3):
                R[b, a] = T_1[k, b, a]
        for i in range(n):
            for a in range(3):
                x = R[0, a] * work[i, 0] + R[1, a] * work[i, 1] + R[2, a] * work[i, 2]
                low[a] = min(low[a], x)
                high[a] = max(high[a], x)
        distance[k] = polytope_mesh(
            work[:n], R, t, low, high, limit[k], no_seed, triangles, lower, upper, child, slabs
        )
