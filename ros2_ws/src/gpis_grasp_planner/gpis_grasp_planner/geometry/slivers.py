"""Faces without area, taken out so that a closed surface stays closed.

A needle (two corners in one place) goes by joining the two; a cap (one corner on the opposite side,
as at a T-junction) by turning the long edge that it shares with its neighbour. Only where there is
no single neighbour is such a face left out, and what it joined is open then.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Faces = NDArray[np.int32]
Triple = tuple[int, int, int]

_STEPS_PER_FACE = 20  # a bound on turning edges to and fro


def altitudes(vertices: Array, faces: Faces) -> Array:
    """Smallest altitude (m,) [m] of each face; 0 where two of its corners are one vertex."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    ab, bc, ca = b - a, c - b, a - c
    longest = np.sqrt(
        np.maximum.reduce([np.einsum("ij,ij->i", side, side) for side in (ab, bc, ca)])
    )
    double_area = np.linalg.norm(np.cross(ab, ca), axis=1)
    return np.divide(double_area, longest, out=np.zeros_like(longest), where=longest > 0)


def without_slivers(vertices: Array, faces: Faces, limit: float) -> tuple[Faces, int]:
    """Faces without those thinner than a limit [m], and how many had to be left out.

    Vertices are not moved, but those of a needle become one.
    """
    thin = np.flatnonzero(altitudes(vertices, faces) <= limit)
    if thin.size == 0:
        return faces, 0
    corners = np.zeros(len(vertices), dtype=bool)
    corners[faces[thin]] = True
    near = corners[faces].any(axis=1)
    work = _Neighbourhood(vertices, faces[near], limit)
    work.repair()
    mended = np.array(work.remaining(), dtype=np.int32).reshape(-1, 3)
    still = altitudes(vertices, mended) <= limit
    left_out = work.left_out + int(still.sum())
    return np.concatenate([faces[~near], mended[~still]]), left_out


class _Neighbourhood:
    """The thin faces and all that share a vertex with one; no other face is ever touched."""

    def __init__(self, vertices: Array, faces: Faces, limit: float):
        self.vertices, self.limit = vertices, limit
        self.faces: dict[int, Triple] = {}
        self.around: dict[int, set[int]] = {}
        self.left_out = 0
        self._next = 0
        self._thin: deque[int] = deque()
        thin = altitudes(vertices, faces) <= limit
        for (a, b, c), is_thin in zip(faces.tolist(), thin.tolist(), strict=True):
            self._add((a, b, c), is_thin)
        self._steps = _STEPS_PER_FACE * (len(self._thin) + 1)

    def remaining(self) -> list[Triple]:
        return [self.faces[f] for f in sorted(self.faces)]

    def repair(self) -> None:
        while self._thin and self._steps > 0:
            self._steps -= 1
            face = self._thin.popleft()
            if face in self.faces:
                self._repair(face)

    def _add(self, face: Triple, is_thin: bool | None = None) -> None:
        self.faces[self._next] = face
        for v in face:
            self.around.setdefault(v, set()).add(self._next)
        if is_thin is None:
            altitude = altitudes(self.vertices, np.array([face], dtype=np.int32))[0]
            is_thin = bool(altitude <= self.limit)
        if is_thin:
            self._thin.append(self._next)
        self._next += 1

    def _remove(self, face: int) -> Triple:
        corners = self.faces.pop(face)
        for v in corners:
            self.around[v].discard(face)
        return corners

    def _repair(self, face: int) -> None:
        corners = self.faces[face]
        if len(set(corners)) < 3:
            self._remove(face)
            return
        sides = [(corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]) for k in range(3)]
        sides.sort(key=lambda s: float(np.linalg.norm(self.vertices[s[0]] - self.vertices[s[1]])))
        a, b, _ = sides[0]
        if np.linalg.norm(self.vertices[a] - self.vertices[b]) <= 2.0 * self.limit:
            self._collapse(a, b)
        else:
            self._turn(face, *sides[2])

    def _collapse(self, kept: int, gone: int) -> None:
        """Join two vertices; what falls in on itself, or back to back on another, goes."""
        for face in list(self.around[gone]):
            a, b, c = (kept if v == gone else v for v in self._remove(face))
            if a != b and b != c and c != a and not self._back_to_back((a, b, c)):
                self._add((a, b, c))

    def _back_to_back(self, corners: Triple) -> bool:
        a, b, _ = corners
        for face in self.around.get(a, set()) & self.around.get(b, set()):
            x, y, z = self.faces[face]
            if corners in ((z, y, x), (y, x, z), (x, z, y)):
                self._remove(face)
                return True
        return False

    def _turn(self, face: int, u: int, v: int, top: int) -> None:
        """Turn the edge u-v of a cap with its corner on it towards the neighbour's corner."""
        others = (self.around[u] & self.around[v]) - {face}
        if not others:
            self.left_out += 1
            self._remove(face)
            return
        neighbour = min(others)
        x, y, z = self.faces[neighbour]
        if len({x, y, z}) < 3:  # u and v are all of its corners: no neighbour, but a line
            self._remove(neighbour)
            self._thin.append(face)
            return
        [far] = {x, y, z} - {u, v}
        if far == top:
            self._remove(face)
            self._remove(neighbour)
            return
        if len(others) > 1 or self.around[top] & self.around[far]:
            self._thin.append(face)  # the turned edge is there already; perhaps not for long
            return
        self._remove(face)
        self._remove(neighbour)
        # The new faces wind as the neighbour did, since the cap's own side means nothing.
        if (u, v) in ((x, y), (y, z), (z, x)):
            u, v = v, u
        self._add((top, u, far))
        self._add((far, v, top))
