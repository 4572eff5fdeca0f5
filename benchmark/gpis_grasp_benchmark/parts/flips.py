"""Better triangles on flat faces: Delaunay edge flips between neighbours in one plane.

Boolean operations leave flat faces cut into needles. Flipping an edge whose opposite angles add
up to more than 180 degrees raises the smallest angle and leaves the surface as it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FLAT_MM = 1e-6  # how far the fourth corner may lie off the plane of the other three
MAX_PASSES = 60


def flip_flat_edges(vertices: Array, faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Faces (m, 3) of the same closed surface without avoidable needles; vertices in mm."""
    faces = faces.copy()
    owner = {(int(face[k]), int(face[k - 2])): i for i, face in enumerate(faces) for k in range(3)}
    candidates = set(owner)
    for _ in range(MAX_PASSES):
        touched: set[tuple[int, int]] = set()
        for a, b in sorted(candidates):
            if a < b and (a, b) in owner:
                touched |= _flip(vertices, faces, owner, a, b)
        if not touched:
            break
        candidates = {(min(e), max(e)) for e in touched}
    return faces


def _flip(
    vertices: Array,
    faces: NDArray[np.int64],
    owner: dict[tuple[int, int], int],
    a: int,
    b: int,
) -> set[tuple[int, int]]:
    """Flip edge (a, b) to (c, d) if that is flat, convex and better; the edges to look at next."""
    i, j = owner[a, b], owner[b, a]
    c, d = int(faces[i].sum()) - a - b, int(faces[j].sum()) - a - b
    if (c, d) in owner or (d, c) in owner:
        return set()
    p_a, p_b, p_c, p_d = vertices[[a, b, c, d]]
    if _angle(p_a, p_c, p_b) + _angle(p_a, p_d, p_b) <= np.pi + 1e-6:
        return set()
    # The normal of the fatter face is the one to trust.
    n_i, n_j = np.cross(p_b - p_a, p_c - p_a), np.cross(p_a - p_b, p_d - p_b)
    normal = n_i if n_i @ n_i > n_j @ n_j else n_j
    normal = normal / np.linalg.norm(normal)
    heights = np.array([p_a, p_b, p_c, p_d]) @ normal
    if np.ptp(heights) > FLAT_MM:
        return set()
    first, second = np.cross(p_d - p_c, p_b - p_c), np.cross(p_c - p_d, p_a - p_d)
    if first @ normal <= 1e-9 or second @ normal <= 1e-9:
        return set()
    faces[i], faces[j] = (c, d, b), (d, c, a)
    del owner[a, b], owner[b, a]
    for face in (i, j):
        for k in range(3):
            owner[int(faces[face, k]), int(faces[face, k - 2])] = face
    return {(a, c), (c, b), (b, d), (d, a)}


def _angle(p: Array, q: Array, r: Array) -> float:
    """Angle [rad] at q."""
    u, v = p - q, r - q
    return float(np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v))
