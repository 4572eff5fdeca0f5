"""Clouds as a depth camera would see a part: points that its rays meet, with noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.directions import even_directions
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.surface_samples import uniform_samples

Array = NDArray[np.float64]

DISTANCE_M = 0.6
_ALL_AROUND = 26
_CANDIDATES = 60
_PAIRS = 400
_TRIED_POINTS = 3000
_OFF_SURFACE_M = 1e-5


@dataclass(frozen=True, eq=False)
class Scan:
    """A cloud in the part's frame.

    Attributes
    ----------
    points : (n, 3) array [m]
    viewpoints : (k, 3) array [m]
        Where the camera stood.
    share : float
        Of the part's area that it saw.
    """

    points: Array
    viewpoints: Array
    share: float


def seen_from(
    mesh: TriangleMesh, points: Array, normals: Array, viewpoints: Array
) -> NDArray[np.bool_]:
    """Which surface points (n, 3) each viewpoint (k, 3) sees: (k, n) bool, by casting rays."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(mesh.vertices.astype(np.float32)),
        o3d.core.Tensor.from_numpy(mesh.faces.astype(np.uint32)),
    )
    start = points + _OFF_SURFACE_M * normals
    seen = np.zeros((len(viewpoints), len(points)), dtype=bool)
    for k, viewpoint in enumerate(viewpoints):
        rays = np.concatenate([start, viewpoint - start], axis=1).astype(np.float32)
        ends = o3d.core.Tensor.from_numpy(rays)
        free = ~scene.test_occlusions(ends, tnear=0.0, tfar=1.0).numpy()
        seen[k] = free & (np.einsum("ij,ij->i", normals, viewpoint - points) > 0.0)
    return seen


def choose_viewpoints(mesh: TriangleMesh, share: float, seed: int) -> Array:
    """One or two viewpoints (k, 3) that together see about a share of the area; all for 1.

    Of 60 single ones and 400 pairs a random one of the five whose share is nearest.
    """
    middle = mesh.bounds.mean(axis=0)
    if share >= 1.0:
        return middle + DISTANCE_M * even_directions(_ALL_AROUND)
    rng = np.random.default_rng(seed)
    samples = uniform_samples(mesh, _TRIED_POINTS, seed)
    ways = rng.normal(size=(_CANDIDATES, 3))
    viewpoints = middle + DISTANCE_M * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    seen = seen_from(mesh, samples.points, samples.normals_outward, viewpoints)
    sets: list[tuple[int, ...]] = [(i,) for i in range(_CANDIDATES)]
    sets += [tuple(rng.choice(_CANDIDATES, 2, replace=False)) for _ in range(_PAIRS)]
    off = [abs(float(seen[list(s)].any(axis=0).mean()) - share) for s in sets]
    chosen = np.argsort(off, kind="stable")[:5]
    return viewpoints[list(sets[int(rng.choice(chosen))])]


def scan(
    mesh: TriangleMesh, share: float, noise_m: float, seed: int, density_per_cm2: float = 30.0
) -> Scan:
    """A cloud of a mesh with Gaussian noise along all axes; equal for equal seeds."""
    count = int(1e4 * density_per_cm2 * float(mesh.face_areas.sum()))
    samples = uniform_samples(mesh, count, seed)
    viewpoints = choose_viewpoints(mesh, share, seed)
    seen = np.ones(count, dtype=bool)  # of all of it: also what lies too deep for any camera
    if share < 1.0:
        by_view = seen_from(mesh, samples.points, samples.normals_outward, viewpoints)
        seen = np.asarray(by_view.any(axis=0))
    noise = np.random.default_rng([seed, 1]).normal(scale=noise_m, size=(int(seen.sum()), 3))
    return Scan(samples.points[seen] + noise, viewpoints, float(seen.mean()))
