"""Household parts, at the size of ordinary objects [mm]; the axis of each is z."""

from __future__ import annotations

import manifold3d
import numpy as np

from gpis_grasp_benchmark.parts.solids import Solid, blended, block, swept, turned


def mug() -> Solid:
    """A stoneware mug with a handle: 84 mm across, 95 mm high, walls of 6 mm."""
    outer = turned(
        [(0, -47.5), (38, -47.5, 4), (42, -40, 12), (42, 47.5, 2.9), (30, 47.5), (0, 47.5)], 52, 10
    )
    cavity = turned([(0, -40.5), (36, -40.5, 9), (36, 41), (36.2, 60), (0, 60)], 52, 10)
    angles = np.linspace(np.deg2rad(118), np.deg2rad(-118), 28)
    path = np.stack([46 + 27 * np.cos(angles), 30 * np.sin(angles)], axis=1)
    handle = swept(path, half_width=7.5, half_depth=4.5, segments=16)
    return (outer + handle) - cavity


def flask() -> Solid:
    """An Erlenmeyer flask of thick glass: 93 mm across, 155 mm high, open at its mouth."""
    outer = turned(
        [(0, -77.5), (50, -77.5, 9), (17, 25, 22), (17, 68, 4), (21, 75.5, 1.2), (21, 77.5, 0.9),
         (0, 77.5)], 40, 12
    )  # fmt: skip
    inner = turned(
        [(0, -72.5), (43.5, -72.5, 5), (12.5, 24, 20), (12.5, 68, 4), (16, 79), (0, 79)], 40, 12
    )
    return outer - inner


def phone() -> Solid:
    """A telephone handset: 196 mm long (x), 50 mm wide, ear and mouth piece facing down."""
    return blended(_handset_distance, (-104, -30, -28), (104, 30, 22), 4.6)


def _handset_distance(x: float, y: float, z: float) -> float:
    arch = z - 10.0 + 6.0 * (x / 80.0) ** 2  # the grip rises in its middle
    grip = _rounded_box((x, y, arch), (84.0, 15.0, 9.0), 7.0)
    pieces = min(_rounded_disc(x - s * 73.0, y, z + 7.0, 25.0, 12.0, 5.0) for s in (-1.0, 1.0))
    # Smooth union (polynomial, 14 mm wide), so that the pieces grow out of the grip.
    h = max(14.0 - abs(grip - pieces), 0.0) / 14.0
    return min(grip, pieces) - h * h * 14.0 / 4.0


def _rounded_box(p: tuple[float, ...], half: tuple[float, ...], radius: float) -> float:
    q = [abs(c) - (h - radius) for c, h in zip(p, half, strict=True)]
    outside = sum(max(v, 0.0) ** 2 for v in q) ** 0.5
    return outside + min(max(q), 0.0) - radius


def _rounded_disc(
    x: float, y: float, z: float, radius: float, half_height: float, fillet: float
) -> float:
    u = (x * x + y * y) ** 0.5 - (radius - fillet)
    v = abs(z) - (half_height - fillet)
    outside = (max(u, 0.0) ** 2 + max(v, 0.0) ** 2) ** 0.5
    return outside + min(max(u, v), 0.0) - fillet


def sphere() -> Solid:
    """A ball of 70 mm."""
    return manifold3d.Manifold.sphere(35.0, 80)


def bishop() -> Solid:
    """A chess bishop with its slit: 48 mm across the base, 120 mm high."""
    body = turned(
        [
            (0, -60), (24, -60, 2), (24, -50, 3), (20.5, -46, 2), (20.5, -42, 3), (12, -34, 12),
            (9, 8, 15), (11, 13, 2), (16, 15, 1.5), (16, 19, 1.5), (11, 21, 2), (11, 25, 2),
            (17, 31, 9), (14.5, 43, 10), (3.5, 52.2, 2), (5.6, 54.6, 1.9), (4.6, 59.4, 2),
            (2.2, 60), (0, 60),
        ],
        40,
        7,
    )  # fmt: skip
    slit = block((40, 60, 3.2), (20, 0, 0)).rotate((0, -40, 0)).translate((3, 0, 32))
    return body - slit
