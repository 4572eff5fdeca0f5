"""A mesh of fewer triangles for a large one, and how far the two are apart.

Edges are collapsed by quadric error (M. Garland, P. Heckbert, "Surface simplification using
quadric error metrics", SIGGRAPH 1997) in the library fast-simplification: two to three seconds for
a million triangles, where Open3D's ordered collapse takes a minute for half the error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.slivers import without_slivers
from gpis_grasp_planner.geometry.surface_samples import uniform_samples
from gpis_grasp_planner.geometry.topology import find_edges
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree

TARGETS = (30_000, 60_000, 120_000)
TOLERANCE = 5e-4  # largest deviation, relative to the largest extent, for which more are not tried
# The library's thresholds are absolute: with a part of this size they rise slowly enough that
# flat places go first. In metres nearly every edge is below the first one.
_EXTENT = 100.0
_AGGRESSION = 5.0
_PROBES = 5_000
_THIN = 1e-7  # altitude of a face without area, relative to the largest extent


@dataclass(frozen=True, eq=False)
class Simplified:
    """A mesh and the largest distance [m] found between it and the original, both ways."""

    mesh: TriangleMesh
    deviation: float


def simplify(mesh: TriangleMesh) -> Simplified | None:
    """Simplify a mesh to 30,000 faces, or more where that leaves it too far from the original.

    Returns None where nothing is won: the mesh is small, or it cannot be simplified without
    opening it.

    Notes
    -----
    The deviation is the largest of 5,000 distances from points of each surface to the other, so a
    lower bound of the Hausdorff distance.
    """
    was_open = find_edges(mesh.faces).open
    tree = TriangleTree.of(mesh)
    best: Simplified | None = None
    for target in TARGETS:
        if len(mesh.faces) <= 2 * target:
            break
        found = _decimated(mesh, target)
        if len(found.faces) > 2 * target or find_edges(found.faces).open > was_open:
            continue
        deviation = _deviation(mesh, tree, found)
        if best is None or deviation < best.deviation:
            best = Simplified(found, deviation)
        if deviation <= TOLERANCE * float(mesh.extent.max()):
            break
    return best


def _decimated(mesh: TriangleMesh, target: int) -> TriangleMesh:
    from fast_simplification import simplify as collapse_edges

    middle = mesh.bounds.mean(axis=0)
    scale = _EXTENT / float(mesh.extent.max())
    points = ((mesh.vertices - middle) * scale).astype(np.float32)
    vertices, faces = collapse_edges(points, mesh.faces, target_count=target, agg=_AGGRESSION)
    used, index = np.unique(faces, return_inverse=True)
    kept = np.asarray(vertices, dtype=float)[used] / scale + middle
    sound, _ = without_slivers(
        kept, index.reshape(-1, 3).astype(np.int32), _THIN * float(mesh.extent.max())
    )
    return TriangleMesh(kept, sound)


def _deviation(mesh: TriangleMesh, tree: TriangleTree, simplified: TriangleMesh) -> float:
    there = tree.nearest(uniform_samples(simplified, _PROBES, seed=0).points)[1]
    back = TriangleTree.of(simplified).nearest(uniform_samples(mesh, _PROBES, seed=0).points)[1]
    return float(max(there.max(), back.max()))
