"""Which vertices of a mesh are one: equal ones always, near ones where that closes the surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.geometry.topology import Edges, find_edges

Array = NDArray[np.float64]
Faces = NDArray[np.int32]
Index = NDArray[np.int64]

WELD = 1e-6  # distance of vertices that are meant as one, relative to the largest extent
# Wider gaps are closed too, but only if that leaves no edge open and no face is lost.
WIDE_WELDS = (1e-5, 1e-4)
MOST_NEIGHBOURS = 20  # mean number of vertices within reach, beyond which nothing is welded
CHAIN = 2.0  # a group of vertices may be this many times the distance across


def merge_equal(vertices: Array, faces: NDArray[np.int64]) -> tuple[Array, Faces]:
    """Vertices without repetitions, in lexicographic order, and faces that use them."""
    vertices = vertices + 0.0  # turns -0.0 into 0.0, which are equal but not the same bytes
    first, index = _first_of_equal(np.ascontiguousarray(vertices).view(np.uint64))
    chosen = vertices[first]
    order = np.lexsort(chosen.T[::-1])
    rank = np.empty(len(order), dtype=np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    return chosen[order], rank[index][faces]


def weld(vertices: Array, faces: Faces, edges: Edges) -> tuple[Faces, float]:
    """Join vertices at open edges that lie within a hair's breadth of each other.

    All pairs closer than `WELD` times the largest extent become one vertex if fewer edges are
    open then. A chain of such pairs that is longer than twice that distance is a small feature and
    stays. If edges are still open, the distances `WIDE_WELDS` are tried.

    Returns
    -------
    faces : (m, 3) int array
        As given where nothing is won.
    distance : float
        The largest distance [m] that was bridged; 0 where nothing was welded.
    """
    extent = float(np.ptp(vertices, axis=0).max())
    bridged = 0.0
    for share in (WELD, *WIDE_WELDS):
        if edges.open == 0:
            break
        welded = _welded(vertices, faces, edges, share * extent)
        if welded is None:
            continue
        found = find_edges(welded)
        if found.open >= edges.open or found.non_manifold > edges.non_manifold:
            continue
        if share > WELD and (found.open or len(welded) < len(faces)):
            continue
        faces, edges, bridged = welded, found, share * extent
    return faces, bridged


def _welded(vertices: Array, faces: Faces, edges: Edges, distance: float) -> Faces | None:
    """Faces with the near vertices of open edges joined, less those that fall in on themselves."""
    rim = np.unique(edges.ends[edges.uses == 1])
    points = vertices[rim]
    tree = cKDTree(points)
    if tree.count_neighbors(tree, distance) > MOST_NEIGHBOURS * len(rim):
        return None
    pairs = tree.query_pairs(distance, output_type="ndarray")
    if len(pairs) == 0:
        return None
    graph = coo_matrix(
        (np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])),
        shape=(len(rim), len(rim)),
    )
    count, group = connected_components(graph, directed=False)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, group, points)
    np.maximum.at(high, group, points)
    short = np.linalg.norm(high - low, axis=1) <= CHAIN * distance
    first = np.full(count, len(rim))
    np.minimum.at(first, group, np.arange(len(rim)))
    joined = np.arange(len(vertices), dtype=np.int32)
    joined[rim] = np.where(short[group], rim[first[group]], rim)
    welded = joined[faces]
    fallen = (welded == np.roll(welded, 1, axis=1)).any(axis=1)
    return welded[~fallen] if not fallen.all() else None


@njit
def _first_of_equal(bits):  # type: ignore[no-untyped-def]
    """First of the rows (n, 3) equal to each other, (k,), and which of them each row is, (n,)."""
    n = bits.shape[0]
    size = 16
    while size < 2 * n:
        size *= 2
    table = np.full(size, -1, dtype=np.int64)
    first = np.empty(n, dtype=np.int64)
    index = np.empty(n, dtype=np.int64)
    k = 0
    mask = np.uint64(size - 1)
    factor = np.uint64(0x9E3779B97F4A7C15)
    shift = np.uint64(29)
    for i in range(n):
        h = np.uint64(0)
        for d in range(3):
            h = (h ^ bits[i, d]) * factor
            h ^= h >> shift
        at = h & mask
        while True:
            found = table[at]
            if found < 0:
                table[at] = k
                first[k] = i
                index[i] = k
                k += 1
                break
            j = first[found]
            if bits[j, 0] == bits[i, 0] and bits[j, 1] == bits[i, 1] and bits[j, 2] == bits[i, 2]:
                index[i] = found
                break
            at = (at + np.uint64(1)) & mask
    return first[:k].copy(), index
