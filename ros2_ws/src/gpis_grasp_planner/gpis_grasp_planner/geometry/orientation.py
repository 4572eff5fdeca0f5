"""Which way the faces of a mesh look, decided by the whole mesh.

Faces are turned patch by patch: a patch is connected by edges with two faces, and winds one way.
A closed patch is judged by its own volume, and by where it lies: one that looks inwards inside
another is the wall of a cavity. An open patch (a face of a CAD model that is not stitched to its
neighbours, the wall of a bore, a mesh with a hole) is judged by rays to both sides, since the
volume that it encloses by itself means nothing. Where they do not decide, the file is believed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from gpis_grasp_planner.geometry.mass_properties import tetrahedra
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.ray_crossings import crossing_numbers, outward_votes
from gpis_grasp_planner.geometry.topology import Edges, faces_to_flip, find_edges
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree

Array = NDArray[np.float64]
Faces = NDArray[np.int32]
Mask = NDArray[np.bool_]
Index = NDArray[np.int64]

DECIDED = 0.25  # least mean vote that turns an open patch
CERTAIN = 0.5  # least mean vote that counts against the volume of a closed patch
FLAT_PATCH = 1e-9  # volume of a closed patch without inside, relative to the extent cubed


@dataclass(frozen=True, eq=False)
class Oriented:
    """Faces (m, 3) that look outwards, and what was done to them.

    Attributes
    ----------
    faces : (m, 3) int array
    turned : (m,) bool array
        Faces that look another way than they did.
    wound : bool
        Whether some of them wound against their neighbours.
    one_sided : (m,) bool array
        Faces of one-sided patches, left as they were.
    undecided : (m,) bool array
        Faces of open patches for which rays tell no side, left as they were.
    """

    faces: Faces
    turned: Mask
    wound: bool
    one_sided: Mask
    undecided: Mask


def orient(vertices: Array, faces: Faces, edges: Edges | None = None) -> Oriented:
    """Turn faces so that they look outwards; a closed mesh that is right costs next to nothing.

    Parameters
    ----------
    vertices : (n, 3) array [m]
    faces : (m, 3) int array
        None without area.
    edges : Edges, optional
        Of the faces, where they are known.
    """
    edges = edges or find_edges(faces)
    n = len(faces)
    turned, one_sided = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    wound = not edges.agree.all()
    if wound:
        turned, one_sided = faces_to_flip(edges, n)
    now = np.where(turned[:, None], faces[:, ::-1], faces)
    count, patch = _patches(edges, n)
    if (edges.uses == 2).all() and not one_sided.any():
        closed = np.ones(count, dtype=bool)
    else:
        closed = _closed_patches(now, patch, count)
    mesh = TriangleMesh(vertices, now)
    volumes = np.bincount(
        patch, tetrahedra(mesh.triangles - vertices.mean(axis=0)), minlength=count
    )
    volumes[np.abs(volumes) <= FLAT_PATCH * float(mesh.extent.max()) ** 3] = 0.0
    flip = np.zeros(count, dtype=bool)
    undecided = np.zeros(count, dtype=bool)
    if not closed.all() or (volumes < 0.0).any():
        tree = TriangleTree.of(mesh)
        votes = outward_votes(tree, patch[tree.faces], count)
        flip = np.where(closed, (volumes < 0.0) & (votes < CERTAIN), votes < -DECIDED)
        undecided = ~closed & (np.abs(votes) <= DECIDED)
        flip |= _cavities_of_inverted(
            mesh, patch, closed & flip, closed & ~flip & (votes < -CERTAIN)
        )
    flip_faces = flip[patch] & ~one_sided
    return Oriented(
        faces=np.where(flip_faces[:, None], now[:, ::-1], now),
        turned=turned ^ flip_faces,
        wound=wound,
        one_sided=one_sided,
        undecided=undecided[patch] & ~one_sided,
    )


def _patches(edges: Edges, n_faces: int) -> tuple[int, Index]:
    """Number of patches and the patch of each face (m,); faces connect by edges of two faces."""
    i, j = edges.pairs[:, 0], edges.pairs[:, 1]
    graph = coo_matrix((np.ones(len(i), dtype=np.int8), (i, j)), shape=(n_faces, n_faces))
    count, label = connected_components(graph, directed=False)
    return int(count), label.astype(np.int64)


def _closed_patches(faces: Faces, patch: Index, count: int) -> Mask:
    """Whether each patch by itself uses its edges as often in one direction as in the other."""
    tail = faces.reshape(-1).astype(np.int64)
    head = np.roll(faces, -1, axis=1).reshape(-1).astype(np.int64)
    low, high = np.minimum(tail, head), np.maximum(tail, head)
    owner = np.repeat(patch, 3)
    order = np.lexsort((owner, low * (int(faces.max()) + 1) + high))
    low, high, owner = low[order], high[order], owner[order]
    new = np.ones(len(order), dtype=bool)
    new[1:] = (low[1:] != low[:-1]) | (high[1:] != high[:-1]) | (owner[1:] != owner[:-1])
    start = np.flatnonzero(new)
    balance = np.add.reduceat(np.where(tail < head, 1, -1)[order], start)
    closed = np.ones(count, dtype=bool)
    closed[owner[start[balance != 0]]] = False
    return closed


def _cavities_of_inverted(
    mesh: TriangleMesh, patch: Index, inverted: Mask, candidates: Mask
) -> Mask:
    """Those of the closed candidates that lie inside an inverted patch: its cavities."""
    found = np.zeros(len(inverted), dtype=bool)
    if not inverted.any() or not candidates.any():
        return found
    tree = TriangleTree.of(TriangleMesh(mesh.vertices, mesh.faces[inverted[patch]]))
    chosen = np.flatnonzero(candidates)
    first = np.array([np.argmax(patch == p) for p in chosen])
    found[chosen] = crossing_numbers(tree, mesh.triangles[first].mean(axis=1)) != 0
    return found
