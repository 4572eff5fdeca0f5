"""Heights of a hand's pieces over a plane, compiled."""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.compiled import njit


@njit
def lowest_heights(vertices, start, piece, T, point, normal, height):  # type: ignore[no-untyped-def]
    """Height of the lowest vertex of M placed pieces over a plane.

    Parameters
    ----------
    vertices, start
        Of `HandPieces`.
    piece : (K,) int array
    T : (B, K, 4, 4) array
        Poses of the pieces' links in the plane's frame.
    point, normal : (3,) arrays
    height : (B,) array [m], out
        Of the lowest of the K pieces.
    """
    for b in range(T.shape[0]):
        best = np.inf
        for k in range(T.shape[1]):
            M = T[b, k]
            base = 0.0
            for a in range(3):
                base += normal[a] * (M[a, 3] - point[a])
            dx = normal[0] * M[0, 0] + normal[1] * M[1, 0] + normal[2] * M[2, 0]
            dy = normal[0] * M[0, 1] + normal[1] * M[1, 1] + normal[2] * M[2, 1]
            dz = normal[0] * M[0, 2] + normal[1] * M[1, 2] + normal[2] * M[2, 2]
            low = np.inf
            for i in range(start[piece[k]], start[piece[k] + 1]):
                low = min(low, dx * vertices[i, 0] + dy * vertices[i, 1] + dz * vertices[i, 2])
            best = min(best, low + base)
        height[b] = best
