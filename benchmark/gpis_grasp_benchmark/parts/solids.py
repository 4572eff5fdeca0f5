"""Building blocks of the part generators: profiles with fillets, turned and extruded solids.

Lengths are millimetres here, as on a drawing. Solids come from manifold3d, whose boolean
operations give closed surfaces by construction.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import manifold3d
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_benchmark.parts.flips import flip_flat_edges

Array = NDArray[np.float64]
Solid = Any  # manifold3d.Manifold, which comes without type information

SIMPLIFY_MM = 0.01


def rounded(corners: Sequence[tuple[float, ...]]) -> Array:
    """A closed polygon (n, 2) from corners (x, y) or (x, y, fillet radius) [mm]."""
    points = np.array([c[:2] for c in corners], dtype=float)
    outline: list[Array] = []
    for i, corner in enumerate(corners):
        radius = corner[2] if len(corner) > 2 else 0.0
        p = points[i]
        if radius == 0.0:
            outline.append(p[None])
            continue
        to_last, to_next = points[i - 1] - p, points[(i + 1) % len(points)] - p
        a, b = to_last / np.linalg.norm(to_last), to_next / np.linalg.norm(to_next)
        half = 0.5 * np.arccos(np.clip(a @ b, -1.0, 1.0))
        reach = radius / np.tan(half)
        if reach > min(np.linalg.norm(to_last), np.linalg.norm(to_next)) + 1e-9:
            raise ValueError(f"a fillet of {radius} mm does not fit corner {i} at {p.tolist()}")
        bisector = (a + b) / np.linalg.norm(a + b)
        center = p + bisector * radius / np.sin(half)
        first, last = p + a * reach - center, p + b * reach - center
        sweep = np.arctan2(first[0] * last[1] - first[1] * last[0], first @ last)
        steps = max(2, int(np.ceil(abs(np.rad2deg(sweep)) / _fillet_step_deg(radius))))
        angles = np.arctan2(first[1], first[0]) + np.linspace(0.0, sweep, steps + 1)
        outline.append(center + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1))
    return np.concatenate(outline)


def _fillet_step_deg(radius: float) -> float:
    """Small fillets get few facets: their deviation stays below 0.2 mm all the same."""
    return 45.0 if radius < 2.5 else 22.5 if radius < 6.0 else 15.0


def densified(polygon: Array, length: float) -> Array:
    """A closed polygon with points added so that no side is longer than `length` [mm]."""
    parts = []
    for p, q in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        n = max(1, int(np.ceil(np.linalg.norm(q - p) / length)))
        parts.append(p + (q - p) * np.arange(n)[:, None] / n)
    return np.concatenate(parts)


def section(polygon: ArrayLike) -> Any:
    """A cross-section from one closed polygon (n, 2), whichever way it winds."""
    points = np.asarray(polygon, dtype=float)
    x, y = points[:, 0], points[:, 1]
    if np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) < 0:
        points = points[::-1]
    return manifold3d.CrossSection([points])


def turned(profile: Sequence[tuple[float, ...]], segments: int, length: float) -> Solid:
    """A body of revolution about z from a closed profile of (radius, z[, fillet]) [mm]."""
    outline = densified(rounded(profile), length)
    return manifold3d.Manifold.revolve(section(outline), segments)


def extruded(polygon: ArrayLike, z_low: float, z_high: float) -> Solid:
    """A prism over a polygon (n, 2) between two heights [mm]."""
    return manifold3d.Manifold.extrude(section(polygon), z_high - z_low).translate((0, 0, z_low))


def cylinder(
    radius: float, z_low: float, z_high: float, segments: int, x: float = 0.0, y: float = 0.0
) -> Solid:
    """An upright cylinder [mm]."""
    body = manifold3d.Manifold.cylinder(z_high - z_low, radius, radius, segments)
    return body.translate((x, y, z_low))


def block(size: Sequence[float], center: Sequence[float], fillet: float = 0.0) -> Solid:
    """A box of size (3,) about center (3,) [mm]; its vertical edges may be rounded."""
    x, y = size[0] / 2, size[1] / 2
    corners = [(-x, -y, fillet), (x, -y, fillet), (x, y, fillet), (-x, y, fillet)]
    body = extruded(rounded(corners), -size[2] / 2, size[2] / 2)
    return body.translate(tuple(center))


def ring_of(count: int, radius: float, phase_deg: float = 0.0) -> list[tuple[float, float]]:
    """Centres (x, y) of a pattern of holes on a pitch circle [mm]."""
    angles = np.deg2rad(phase_deg) + 2.0 * np.pi * np.arange(count) / count
    return [(float(radius * np.cos(a)), float(radius * np.sin(a))) for a in angles]


def swept(path: Array, half_width: float, half_depth: float, segments: int) -> Solid:
    """An elliptical bar along a path (n, 2) in the x-z plane, its half width along y [mm]."""
    path = np.asarray(path, dtype=float)
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    across = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    angles = 2.0 * np.pi * np.arange(segments) / segments
    radial = path[:, None] + half_depth * np.cos(angles)[None, :, None] * across[:, None]
    y = np.broadcast_to(half_width * np.sin(angles), radial.shape[:2])
    rings = np.stack([radial[..., 0], y, radial[..., 1]], axis=-1).reshape(-1, 3)
    n = len(path)
    along, around = np.meshgrid(np.arange(n - 1), np.arange(segments), indexing="ij")
    a, b = along * segments + around, along * segments + (around + 1) % segments
    c, d = a + segments, b + segments
    sides = np.stack([a, b, d, a, d, c], axis=-1).reshape(-1, 3)
    low, high = len(rings), len(rings) + 1
    j, k = np.arange(segments), (np.arange(segments) + 1) % segments
    top = (n - 1) * segments
    bottom_cap = np.stack([np.full(segments, low), k, j], axis=1)
    top_cap = np.stack([np.full(segments, high), top + j, top + k], axis=1)
    ends = np.array([[path[0, 0], 0.0, path[0, 1]], [path[-1, 0], 0.0, path[-1, 1]]])
    return from_arrays(np.concatenate([rings, ends]), np.concatenate([sides, bottom_cap, top_cap]))


def from_arrays(vertices: Array, faces: NDArray[np.int64]) -> Solid:
    """A solid from a closed mesh, turned to face outwards."""
    for oriented in (faces, faces[:, ::-1]):
        mesh = manifold3d.Mesh64(vertices, np.ascontiguousarray(oriented).astype(np.uint64))
        body = manifold3d.Manifold(mesh)
        if body.volume() > 0.0:
            return body
    raise ValueError(f"the mesh is not closed: {body.status()}")


def blended(
    distance: Callable[[float, float, float], float], low: ArrayLike, high: ArrayLike, edge: float
) -> Solid:
    """The body where a signed distance (negative inside) [mm] is below zero, within a box."""
    box = [*np.asarray(low, dtype=float), *np.asarray(high, dtype=float)]
    return manifold3d.Manifold.level_set(
        lambda x, y, z: -distance(x, y, z), box, edge, 0.0, edge * 0.02
    )


def finished(body: Solid, max_edge: float) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (n, 3) [mm] and faces (m, 3) of a solid without needless or overlong edges."""
    mesh = body.simplify(SIMPLIFY_MM).refine_to_length(max_edge).to_mesh64()
    vertices = np.array(mesh.vert_properties[:, :3], dtype=np.float64)
    return vertices, flip_flat_edges(vertices, np.array(mesh.tri_verts, dtype=np.int64))
