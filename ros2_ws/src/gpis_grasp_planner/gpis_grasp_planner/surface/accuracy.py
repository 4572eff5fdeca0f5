"""Accuracy of the implicit surface against meshes: ``python -m ...surface.accuracy DIR...``.

For every mesh the zero set is sampled afresh (points of the mesh, disturbed, then Newton steps
along the gradient), and each of its points is compared with the exact nearest point of the mesh:
the distance, and the angle between the gradient and the normal of the nearest face. Points nearer
to a sharp edge than 1 % of the diagonal are left out of the angle, as a smooth surface has no
normal there to be right about.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.surface.chart import project
from gpis_grasp_planner.surface.implicit_surface import fit_part
from gpis_grasp_planner.surface.sampling import sample_uniform
from gpis_grasp_planner.surface.settings import SurfaceSettings

Array = NDArray[np.float64]

SHARP_EDGE_RAD = math.radians(30.0)
EDGE_MARGIN = 0.01
DISTURBANCE = 0.003


@dataclass(frozen=True)
class Accuracy:
    """What :func:`measure` found for one mesh; distances in metres, angles in degrees.

    `values_at_mesh` is |f| at points of the mesh itself, the other direction of the comparison.
    """

    n_samples: int
    n_patches: int
    diagonal: float
    fit_s: float
    evaluation_us: float
    converged: float
    distances: Array
    angles_deg: Array
    smooth: NDArray[np.bool_]
    values_at_mesh: Array


def measure(
    mesh: TriangleMesh, settings: SurfaceSettings, seed: int = 0, n_points: int = 4000
) -> Accuracy:
    """Fit one mesh and compare the zero set with it at `n_points` fresh points."""
    begin = time.perf_counter()
    surface = fit_part(mesh, settings, seed)
    fit_s = time.perf_counter() - begin
    on_mesh, _ = sample_uniform(mesh, n_points, seed + 1)
    rng = np.random.default_rng([seed, 2])
    disturbed = on_mesh + DISTURBANCE * mesh.diagonal * rng.normal(size=on_mesh.shape)
    begin = time.perf_counter()
    surface.value_and_gradient(disturbed)
    evaluation_us = 1e6 * (time.perf_counter() - begin) / n_points
    x, converged = project(surface, disturbed)
    x = x[converged]
    distances, face, _ = nearest_on_mesh(mesh, x)
    gradient = surface.gradient(x)
    normal = mesh.face_normals_outward[face]
    cosine = np.einsum("ij,ij->i", gradient, normal) / np.linalg.norm(gradient, axis=1)
    return Accuracy(
        n_samples=len(surface.points),
        n_patches=surface.n_patches,
        diagonal=mesh.diagonal,
        fit_s=fit_s,
        evaluation_us=evaluation_us,
        converged=float(converged.mean()),
        distances=distances,
        angles_deg=np.degrees(np.arccos(cosine.clip(-1.0, 1.0))),
        smooth=distance_to_sharp_edges(mesh, x) > EDGE_MARGIN * mesh.diagonal,
        values_at_mesh=np.abs(surface.value(on_mesh)),
    )


def nearest_on_mesh(mesh: TriangleMesh, points: Array) -> tuple[Array, NDArray[np.int64], Array]:
    """Exact distance to the mesh: distances (n,) [m], faces (n,) and nearest points (n, 3).

    All faces are tried, but a face whose bounding sphere is farther than the best so far costs
    only a few nanoseconds: about 20 us a point for 9,000 faces.
    """
    triangles = np.ascontiguousarray(mesh.triangles)
    center = triangles.mean(axis=1)
    radius = np.linalg.norm(triangles - center[:, None], axis=2).max(axis=1)
    return _nearest(np.ascontiguousarray(points), triangles, center, radius)


def sharp_edges(mesh: TriangleMesh) -> Array:
    """End points (e, 2, 3) of the edges whose faces meet at more than 30 degrees, or are open."""
    _, vertex = np.unique(mesh.vertices, axis=0, return_inverse=True)
    solid = mesh.face_areas > 0.0
    faces = vertex.ravel()[mesh.faces[solid]]
    corners = mesh.vertices[mesh.faces[solid]]
    normals = mesh.face_normals_outward[solid]
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    where = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    owner = np.tile(np.arange(len(faces)), 3)
    _, first, group, count = np.unique(
        np.sort(ends, axis=1), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    total = np.zeros((len(first), 3))
    np.add.at(total, group.ravel(), normals[owner])
    # Two unit normals at an angle alpha add up to the length 2 cos(alpha / 2).
    smooth = (count == 2) & (np.linalg.norm(total, axis=1) > 2.0 * math.cos(SHARP_EDGE_RAD / 2.0))
    return where[first[~smooth]]


def distance_to_sharp_edges(mesh: TriangleMesh, points: Array) -> Array:
    """Distances (n,) [m] to the nearest sharp edge; infinity where there is none."""
    edges = sharp_edges(mesh)
    if not len(edges):
        return np.full(len(points), np.inf)
    triangles = np.concatenate([edges, edges[:, 1:]], axis=1)
    center = edges.mean(axis=1)
    radius = 0.5 * np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    return _nearest(np.ascontiguousarray(points), triangles, center, radius)[0]


@numba.njit(cache=True, nogil=True)
def _nearest(
    points: Array, triangles: Array, center: Array, radius: Array
) -> tuple[Array, NDArray[np.int64], Array]:
    n = points.shape[0]
    distance = np.empty(n)
    face = np.zeros(n, dtype=np.int64)
    nearest = np.empty((n, 3))
    for i in range(n):
        best = np.inf
        for j in range(triangles.shape[0]):
            r2 = 0.0
            for t in range(3):
                r2 += (points[i, t] - center[j, t]) ** 2
            reach = best + radius[j]
            if r2 >= reach * reach:
                continue
            q = _closest_on_triangle(points[i], triangles[j])
            r = math.sqrt(
                (points[i, 0] - q[0]) ** 2 + (points[i, 1] - q[1]) ** 2 + (points[i, 2] - q[2]) ** 2
            )
            if r < best:
                best = r
                face[i] = j
                nearest[i, 0], nearest[i, 1], nearest[i, 2] = q
        distance[i] = best
    return distance, face, nearest


@numba.njit(cache=True, nogil=True)
def _closest_on_segment(p: Array, a: Array, b: Array) -> tuple[float, float, float]:
    along = 0.0
    squared = 0.0
    for t in range(3):
        along += (p[t] - a[t]) * (b[t] - a[t])
        squared += (b[t] - a[t]) ** 2
    s = min(1.0, max(0.0, along / squared)) if squared > 0.0 else 0.0
    return a[0] + s * (b[0] - a[0]), a[1] + s * (b[1] - a[1]), a[2] + s * (b[2] - a[2])


@numba.njit(cache=True, nogil=True)
def _closest_on_triangle(p: Array, triangle: Array) -> tuple[float, float, float]:
    """Nearest point of a triangle: the foot in its plane if inside, else the best of the edges."""
    a, b, c = triangle[0], triangle[1], triangle[2]
    nx = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])
    ny = (b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2])
    nz = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    squared = nx * nx + ny * ny + nz * nz
    if squared > 0.0:
        inside = True
        for k in range(3):
            u = triangle[k]
            v = triangle[(k + 1) % 3]
            ex, ey, ez = v[0] - u[0], v[1] - u[1], v[2] - u[2]
            px, py, pz = p[0] - u[0], p[1] - u[1], p[2] - u[2]
            turn = nx * (ey * pz - ez * py) + ny * (ez * px - ex * pz) + nz * (ex * py - ey * px)
            if turn < 0.0:
                inside = False
        if inside:
            h = ((p[0] - a[0]) * nx + (p[1] - a[1]) * ny + (p[2] - a[2]) * nz) / squared
            return p[0] - h * nx, p[1] - h * ny, p[2] - h * nz
    best = np.inf
    result = (a[0], a[1], a[2])
    for k in range(3):
        q = _closest_on_segment(p, triangle[k], triangle[(k + 1) % 3])
        r2 = (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2
        if r2 < best:
            best = r2
            result = q
    return result
