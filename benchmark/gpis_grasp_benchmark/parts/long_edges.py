"""Faces without overlong edges, by halving.

manifold3d's own refinement (3.5) ends the process on the needles of a rod's ends.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_benchmark.parts.flips import flip_flat_edges
from gpis_grasp_benchmark.parts.solids import SIMPLIFY_MM, Solid

Array = NDArray[np.float64]
Faces = NDArray[np.int64]


def halved(body: Solid, max_edge: float) -> tuple[Array, Faces]:
    """Vertices (n, 3) [mm] and faces (m, 3) of a solid, no edge longer than `max_edge`."""
    mesh = body.simplify(SIMPLIFY_MM).to_mesh64()
    vertices = np.array(mesh.vert_properties[:, :3], dtype=np.float64)
    faces = flip_flat_edges(vertices, np.array(mesh.tri_verts, dtype=np.int64))
    while (split := _halved_once(vertices, faces, max_edge)) is not None:
        vertices, faces = split
    return vertices, flip_flat_edges(vertices, faces)


def _halved_once(vertices: Array, faces: Faces, max_edge: float) -> tuple[Array, Faces] | None:
    """Every face with an overlong longest edge cut there, with the face beyond it; None at the end.

    An edge is cut only where it is the longest of both its faces, so that the mesh stays closed
    and needles get no narrower; the longest of all is such an edge.
    """
    corners = vertices[faces]
    length = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
    longest = np.argmax(np.round(length, 9), axis=1)
    rows = np.arange(len(faces))
    a, b = faces[rows, longest], faces[rows, (longest + 1) % 3]
    by_edge: dict[tuple[int, int], list[int]] = {}
    for row in rows[length[rows, longest] > max_edge]:
        by_edge.setdefault((int(min(a[row], b[row])), int(max(a[row], b[row]))), []).append(row)
    cut = {edge: pair for edge, pair in by_edge.items() if len(pair) == 2}
    if not by_edge:
        return None
    made, added = list(faces), list(vertices)
    for (u, v), pair in cut.items():
        middle = len(added)
        added.append(0.5 * (vertices[u] + vertices[v]))
        for row in pair:
            i, j, k = np.roll(faces[row], -longest[row])
            made[row] = np.array([i, middle, k])
            made.append(np.array([middle, j, k]))
    if not cut:  # the longest of all has a face whose longest edge is an equal one: cut it alone
        row = int(np.argmax(length[rows, longest]))
        return _with_one_cut(vertices, faces, int(a[row]), int(b[row]))
    return np.array(added), np.array(made)


def _with_one_cut(vertices: Array, faces: Faces, u: int, v: int) -> tuple[Array, Faces]:
    """One edge cut, whatever its two faces' longest edges are."""
    middle = len(vertices)
    made: list[Faces] = []
    for face in faces:
        position = [k for k in range(3) if {face[k], face[(k + 1) % 3]} == {u, v}]
        if not position:
            made.append(face)
            continue
        i, j, k = np.roll(face, -position[0])
        made += [np.array([i, middle, k]), np.array([middle, j, k])]
    return np.vstack([vertices, 0.5 * (vertices[u] + vertices[v])]), np.array(made)
