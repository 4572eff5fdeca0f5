"""What the edges of a triangle soup tell: closed, manifold, bodies, and which way faces wind."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Faces = NDArray[np.int32]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Edges:
    """The undirected edges of faces (m, 3) and how faces use them.

    Attributes
    ----------
    ends : (e, 2) int
        The two vertices of each edge, the lower index first.
    uses : (e,) int
        Number of faces at each edge.
    balance : (e,) int
        Uses in one direction minus uses in the other: 0 everywhere on a closed surface.
    pairs : (p, 2) int
        The two faces at each edge that has exactly two, in the order of the edges.
    agree : (p,) bool
        Whether the two wind the same way.
    """

    ends: Index
    uses: Index
    balance: Index
    pairs: Index
    agree: NDArray[np.bool_]

    @property
    def open(self) -> int:
        """Number of edges where the surface ends."""
        return int(np.count_nonzero(self.uses == 1))

    @property
    def non_manifold(self) -> int:
        """Number of edges with more than two faces."""
        return int(np.count_nonzero(self.uses > 2))

    @property
    def closed(self) -> bool:
        """Whether every edge is used as often in one direction as in the other."""
        return bool((self.balance == 0).all())


def find_edges(faces: Faces) -> Edges:
    """Edges of faces (m, 3); sorting 3 m entries."""
    tail = faces.reshape(-1).astype(np.int64)
    head = np.roll(faces, -1, axis=1).reshape(-1).astype(np.int64)
    low, high = np.minimum(tail, head), np.maximum(tail, head)
    size = int(faces.max(initial=0)) + 1
    key = low * size + high
    order = np.argsort(key, kind="stable")
    key = key[order]
    start = np.flatnonzero(np.diff(key, prepend=-1))
    keys, uses = key[start], np.diff(start, append=len(key))
    direction = np.where(tail < head, 1, -1)[order]
    balance = np.add.reduceat(direction, start) if len(start) else np.zeros(0, dtype=np.int64)
    first = start[uses == 2]
    owner = order // 3
    pairs = np.stack([owner[first], owner[first + 1]], axis=1)
    agree = direction[first] != direction[first + 1]
    ends = np.stack([keys // size, keys % size], axis=1)
    return Edges(ends, uses, balance, pairs, agree)


def bodies(faces: Faces) -> tuple[int, Index]:
    """Number of connected pieces, and the piece of each face (m,); faces connect by vertices."""
    n = int(faces.max(initial=-1)) + 1
    rows = np.concatenate([faces[:, 0], faces[:, 1]])
    columns = np.concatenate([faces[:, 1], faces[:, 2]])
    _, label_of_vertex = _components(n, rows, columns)
    names, labels = np.unique(label_of_vertex[faces[:, 0]], return_inverse=True)
    return len(names), labels.astype(np.int64)


def faces_to_flip(edges: Edges, n_faces: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which faces (m,) to turn so that neighbours agree, and of which (m,) that is impossible.

    Each face stands twice in a graph, as it is and flipped; neighbours that agree link equal
    copies, others link opposite ones. A component of the graph is one consistent choice; of the
    two choices of a piece, the one that turns fewer faces is taken. A one-sided piece (a Moebius
    strip) has both copies of a face in one component; it is left as it is.
    """
    i, j = edges.pairs[:, 0], edges.pairs[:, 1]
    shift = np.where(edges.agree, 0, n_faces)
    rows = np.concatenate([i, i + n_faces])
    columns = np.concatenate([j + shift, j + (n_faces - shift)])
    size = 2 * n_faces
    count, label = _components(size, rows, columns)
    as_is, flipped = label[:n_faces], label[n_faces:]
    kept = np.bincount(as_is, minlength=count)
    turned = np.bincount(flipped, minlength=count)
    # Component c keeps `kept[c]` faces as they are and turns `turned[c]`; its mirror image does
    # the opposite. A face is turned if its as-is copy lies in the worse of the two, ties to the
    # choice that keeps the piece's first face.
    first = np.full(count, n_faces)
    np.minimum.at(first, as_is, np.arange(n_faces))
    worse = kept[as_is] < turned[as_is]
    tie = kept[as_is] == turned[as_is]
    return worse | (tie & (first[as_is] > first[flipped])), as_is == flipped


def _components(n: int, rows: Index, columns: Index) -> tuple[int, Index]:
    """Number of components of a graph of n nodes with edges rows to columns, and each node's."""
    from scipy.sparse import coo_matrix  # not for who only counts edges, as a hand's shapes do
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(n, n))
    count, label = connected_components(graph, directed=False)
    return int(count), label.astype(np.int64)
