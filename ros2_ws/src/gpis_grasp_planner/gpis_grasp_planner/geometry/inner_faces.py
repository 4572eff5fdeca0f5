"""Faces that bound no solid though a solid is there: back sides, and walls inside a body.

Programs that show surfaces from both sides export each face twice, once turned round. Bodies that
were put together keep the wall between them. Either hides what the rest encloses.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.orientation import Oriented
from gpis_grasp_planner.geometry.ray_crossings import crossing_numbers
from gpis_grasp_planner.geometry.topology import find_edges
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree

Array = NDArray[np.float64]
Faces = NDArray[np.int32]
Mask = NDArray[np.bool_]


def repeats(faces: Faces) -> tuple[Mask, Mask]:
    """Which faces (m,) repeat one with their winding, and which of the others one from behind.

    Of such a pair from both sides, one is right where the surface is closed and manifold with it. A
    sheet from both sides is open with one of them, and has no back side.
    """
    corners = np.sort(faces, axis=1)
    after_least = (faces.argmin(axis=1)[:, None] + 1) % 3
    turned = np.take_along_axis(faces, after_least, axis=1)[:, 0] != corners[:, 1]
    order = np.lexsort((turned, *corners.T))
    same = (corners[order[1:]] == corners[order[:-1]]).all(axis=1)
    alike = turned[order[1:]] == turned[order[:-1]]
    duplicates, behind = (np.zeros(len(faces), dtype=bool) for _ in range(2))
    duplicates[order[1:][same & alike]] = True
    behind[order[1:][same & ~alike]] = True
    if behind.any() and not _is_closed(faces[~(duplicates | behind)]):
        behind[:] = False
    return duplicates, behind


def inner_walls(vertices: Array, oriented: Oriented) -> Mask:
    """Which faces (m,) are walls in a body: no side is outside, and the rest is closed round them.

    A sheet that is not wholly inside stays with all others: a hand may meet it.
    """
    doubtful = oriented.undecided
    nothing = np.zeros(len(doubtful), dtype=bool)
    if not doubtful.any() or doubtful.all() or not _is_closed(oriented.faces[~doubtful]):
        return nothing
    tree = TriangleTree.of(TriangleMesh(vertices, oriented.faces[~doubtful]))
    middles = vertices[oriented.faces[doubtful]].mean(axis=1)
    return doubtful if (crossing_numbers(tree, middles) != 0).all() else nothing


def _is_closed(faces: Faces) -> bool:
    return len(faces) > 0 and bool((find_edges(faces).uses == 2).all())
