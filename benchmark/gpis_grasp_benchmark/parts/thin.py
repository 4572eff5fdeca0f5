"""Thin, long, flat and small parts [mm]: what a hand of fist-sized fingers finds hard to hold.

Each function makes one size; the sizes that make up the hard set are in `hard`.
"""

from __future__ import annotations

import manifold3d
import numpy as np

from gpis_grasp_benchmark.parts.solids import (
    Solid,
    block,
    cylinder,
    extruded,
    rounded,
    swept,
    turned,
)


def rod(diameter: float, length: float) -> Solid:
    """A round rod with chamfered ends, along x."""
    r, h, c = diameter / 2, length / 2, min(1.0, 0.1 * diameter)
    profile = [(0.0, -h), (r - c, -h), (r, -h + c), (r, h - c), (r - c, h), (0.0, h)]
    return turned(profile, 32, 10).rotate((0, 90, 0))


def shaft(diameters: tuple[float, ...], lengths: tuple[float, ...]) -> Solid:
    """A shaft of steps, along x."""
    ends = np.cumsum([-sum(lengths) / 2, *lengths])
    profile: list[tuple[float, ...]] = [(0.0, float(ends[0]))]
    for diameter, low, high in zip(diameters, ends[:-1], ends[1:], strict=True):
        profile += [(diameter / 2, float(low)), (diameter / 2, float(high))]
    profile.append((0.0, float(ends[-1])))
    return turned(profile, 40, 10).rotate((0, 90, 0))


def hexagon_key(across_flats: float, long: float, short: float) -> Solid:
    """A hexagon key: two legs at a right angle about a bend, the long one along x."""
    bend = 1.5 * across_flats
    angles = np.linspace(0.0, 0.5 * np.pi, 7)[1:-1]
    arc = bend * np.stack([1.0 - np.sin(angles), np.cos(angles) - 1.0], axis=1)
    legs = [[long, 0.0], [0.5 * long, 0.0], [bend, 0.0]], [[0.0, -bend], [0.0, -short]]
    path = np.concatenate([legs[0], arc, legs[1]]) - [0.4 * long, 0.0]
    corner = across_flats / np.sqrt(3.0)
    return swept(path, corner, corner, 6)


def screwdriver(handle: float, grip: float, blade: float, reach: float) -> Solid:
    """A screwdriver along x: a grip with six flutes, a round blade with a flat tip."""
    r = handle / 2
    body = turned([(0, 0), (0.8 * r, 0, 2), (r, 0.2 * grip, 4), (r, 0.8 * grip, 4),
                   (0.55 * r, grip), (0, grip)], 36, 8)  # fmt: skip
    for k in range(6):
        a = k * np.pi / 3
        body -= cylinder(
            0.22 * r, 0.25 * grip, 2 * grip, 12, r * 1.05 * np.cos(a), r * 1.05 * np.sin(a)
        )
    bar = cylinder(blade / 2, grip - 5, grip + reach, 20)
    tip = block((2 * blade, 2 * blade, 10), (blade + 0.5, 0, grip + reach - 4))
    bar = bar - tip - tip.mirror((1, 0, 0))
    return (body + bar).translate((0, 0, -grip / 2 - reach / 3)).rotate((0, 90, 0))


def knife(length: float, width: float, thickness: float) -> Solid:
    """Cutlery: a flat blade that goes over into a thicker handle, along x."""
    blade = extruded(
        rounded([(0, -width / 2), (0.5 * length, -width / 2, 0.4 * width),
                 (0.5 * length, width / 2, 0.2 * width), (0, width / 2)]),
        -thickness / 2, thickness / 2,
    )  # fmt: skip
    path = np.stack([np.linspace(-length / 2, 3.0, 16), np.zeros(16)], axis=1)
    return blade + swept(path, 0.4 * width, 1.2 * thickness, 16)


def spoon(length: float, width: float, thickness: float) -> Solid:
    """Cutlery: a shallow bowl on a curved flat stem, along x."""
    bowl = manifold3d.Manifold.sphere(0.5, 48).scale((1.5 * width, width, 0.5 * width))
    hollow = manifold3d.Manifold.sphere(0.5, 48).scale(
        (1.5 * width - 2 * thickness, width - 2 * thickness, 0.5 * width - 2 * thickness)
    )
    bowl = bowl - hollow - block((3 * width, 3 * width, width), (0, 0, 0.5 * width + 0.001))
    x = np.linspace(0.7 * width, length - 0.75 * width, 20)
    path = np.stack([x, 0.12 * width * np.sin(np.pi * (x - x[0]) / (x[-1] - x[0]))], axis=1)
    stem = swept(path, 0.16 * width + 2.0, thickness, 16).translate((0, 0, -thickness))
    return (bowl + stem).translate((-0.5 * length + 0.75 * width, 0, 0))


def plate(length: float, width: float, thickness: float) -> Solid:
    """A flat plate with rounded corners."""
    return block((length, width, thickness), (0, 0, 0), min(6.0, 0.15 * width))


def drilled_plate(length: float, width: float, thickness: float) -> Solid:
    """A plate with four holes."""
    body = plate(length, width, thickness)
    for x in (-0.35 * length, 0.35 * length):
        for y in (-0.3 * width, 0.3 * width):
            body -= cylinder(0.08 * width, -thickness, thickness, 24, x, y)
    return body


def bracket(leg: float, foot: float, width: float, thickness: float) -> Solid:
    """Sheet metal: an angle with a bend radius and a hole in each leg, along y."""
    t, r = thickness, 2.0 * thickness
    outline = rounded([(0, 0, r), (foot, 0), (foot, t), (t, t, r - t / 2), (t, leg), (0, leg)])
    body = extruded(outline, -width / 2, width / 2)
    hole = cylinder(0.15 * width, -foot, foot, 24)
    body = body - hole.rotate((90, 0, 0)).translate((0.6 * foot, 0, 0))
    body = body - hole.rotate((0, 90, 0)).translate((0, 0.6 * leg, 0))
    return body.translate((-foot / 4, -leg / 4, 0))


def l_profile(side: float, thickness: float, length: float) -> Solid:
    """A rolled L profile, along z."""
    t = thickness
    outline = rounded([(0, 0), (side, 0), (side, t), (t, t, t / 2), (t, side), (0, side)])
    return extruded(outline, -length / 2, length / 2).translate((-side / 4, -side / 4, 0))


def u_profile(side: float, thickness: float, length: float) -> Solid:
    """A U profile, along z."""
    s, t = side, thickness
    outline = rounded([(0, 0), (s, 0), (s, s), (s - t, s), (s - t, t), (t, t), (t, s), (0, s)])
    return extruded(outline, -length / 2, length / 2).translate((-s / 2, -s / 3, 0))


def ring(outer: float, inner: float, height: float) -> Solid:
    """A ring of rectangular section."""
    a, b, h = inner / 2, outer / 2, height / 2
    f = min(1.0, 0.2 * (b - a), 0.2 * h)
    return turned([(a, -h, f), (b, -h, f), (b, h, f), (a, h, f)], 56, 8)


def disc(diameter: float, height: float) -> Solid:
    """A flat disc."""
    r, h = diameter / 2, height / 2
    return turned([(0, -h), (r, -h, min(1.0, 0.3 * h)), (r, h, min(1.0, 0.3 * h)), (0, h)], 48, 8)


def small_block(x: float, y: float, z: float) -> Solid:
    """A block of twelve faces before it is refined."""
    return block((x, y, z), (0, 0, 0))


def pin(diameter: float, length: float) -> Solid:
    """A dowel pin with rounded ends, along x."""
    r, h = diameter / 2, length / 2
    return turned([(0, -h), (r, -h, 0.3 * r), (r, h, 0.3 * r), (0, h)], 24, 6).rotate((0, 90, 0))
