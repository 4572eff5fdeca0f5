"""Parts of a gearbox [mm]; the axis of each turned part is z."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_benchmark.parts.solids import (
    Solid,
    block,
    cylinder,
    extruded,
    ring_of,
    rounded,
    turned,
)

PRESSURE_ANGLE = np.deg2rad(20.0)


def involute_outline(module: float, teeth: int, flank_points: int = 5) -> NDArray[np.float64]:
    """Outline (n, 2) [mm] of a spur gear: 20 deg involutes, addendum 1, dedendum 1.25 modules.

    A point at radius r of the involute of base radius b has the polar angle inv(acos(b / r)),
    inv(a) = tan(a) - a; half a tooth at the pitch circle spans pi / (2 teeth). Below the base
    circle the flank goes straight down to the root.
    """
    pitch = 0.5 * module * teeth
    base, tip, root = pitch * np.cos(PRESSURE_ANGLE), pitch + module, pitch - 1.25 * module
    radii = np.linspace(max(base, root), tip, flank_points)
    at_radius = np.arccos(np.minimum(1.0, base / radii))
    half = 0.5 * np.pi / teeth + np.tan(PRESSURE_ANGLE) - PRESSURE_ANGLE
    half_angles = half - (np.tan(at_radius) - at_radius)
    if root < base:
        radii, half_angles = np.r_[root, radii], np.r_[half_angles[0], half_angles]
    r = np.concatenate([radii, radii[::-1]])
    tooth = np.concatenate([-half_angles, half_angles[::-1]])
    centers = 2.0 * np.pi * np.arange(teeth) / teeth
    angles = (centers[:, None] + tooth[None]).reshape(-1)
    r = np.tile(r, teeth)
    return np.stack([r * np.cos(angles), r * np.sin(angles)], axis=1)


def spur_gear() -> Solid:
    """A spur gear, module 4, 22 teeth, with hub, keyed bore and lightening holes."""
    rim = extruded(involute_outline(4.0, 22), -12, 12)
    web = turned([(20, 6, 2), (34, 6, 2), (35.5, 14), (18.5, 14)], 44, 11)
    body = rim - web - web.mirror((0, 0, 1))
    for x, y in ring_of(5, 27.0):
        body -= cylinder(4.5, -20, 20, 24, x, y)
    hub = turned([(0, -12), (18, -12), (18, 20, 1.5), (0, 20)], 44, 11)
    bore = cylinder(11, -30, 30, 48) + block((10, 6, 60), (9.3, 0, 0))
    return ((body + hub) - bore).translate((0, 0, -4))


def stepped_shaft() -> Solid:
    """A shaft of 170 mm with five steps (20 to 36 mm), a keyway and a centre bore."""
    body = turned(
        [
            (0, -85), (10, -85, 1), (10, -50, 1), (13, -50, 0.8), (13, -15, 1), (18, -15, 1),
            (18, 10, 1), (15, 10, 1), (15, 50, 0.8), (11, 50, 1), (11, 85, 1), (0, 85),
        ],
        44,
        11,
    )  # fmt: skip
    slot = block((20, 8, 30), (21, 0, 30))
    for z in (15.0, 45.0):
        slot += cylinder(4, 11, 31, 24).rotate((0, 90, 0)).translate((0, 0, z))
    centers = turned([(0, -90), (3, -90), (3, -82), (0, -79)], 16, 6)
    return body - slot - centers - centers.mirror((0, 0, 1))


def flange() -> Solid:
    """A hub flange of 116 mm with six bolt holes and a bore of 32 mm."""
    body = turned(
        [
            (16, -20, 1), (58, -20, 1.5), (58, -7, 1.5), (30, -7, 5), (27, 20, 2), (16, 20, 1),
        ],
        44,
        11,
    )  # fmt: skip
    for x, y in ring_of(6, 44.0):
        body -= cylinder(5, -30, 10, 28, x, y)
    return body


def housing() -> Solid:
    """A gearbox housing: an open box, 146 x 96 x 84 mm, with bearing seats, ribs and feet."""
    shell = block((118, 84, 84), (0, 0, 0), fillet=12)
    seats = _along_y(26, 96, x=-24) + _along_y(22, 96, x=30)
    ribs = block((6, 95, 38), (-24, 0, -23)) + block((6, 95, 38), (30, 0, -23))
    feet = block((146, 84, 8), (0, 0, -38), fillet=12)
    rim = block((128, 94, 7), (0, 0, 38.5), fillet=14)
    body = shell + seats + ribs + feet + rim
    body -= block((104, 70, 84), (0, 0, 8), fillet=7)
    body -= _along_y(18, 120, x=-24) + _along_y(14, 120, x=30)
    for x in (-66.0, 66.0):
        for y in (-28.0, 28.0):
            body -= cylinder(3.5, -60, 0, 20, x, y)
    return body


def _along_y(radius: float, length: float, x: float) -> Solid:
    lying = cylinder(radius, -length / 2, length / 2, 32).rotate((90, 0, 0))
    return lying.translate((x, 0, 0))


def planet_carrier() -> Solid:
    """A planet carrier: a disc of 112 mm with three planet pins, a hub and windows."""
    body = turned([(13, -20, 1), (56, -20, 1.5), (56, -8, 1.5), (13, -8)], 44, 11)
    body += turned([(13, -10), (22, -10), (22, 6, 1.5), (13, 6, 1)], 44, 11)
    for x, y in ring_of(3, 38.0):
        pin = turned(
            [(0, -12), (13, -12), (13, -5, 1), (9, -5, 0.5), (9, 20, 1.2), (0, 20)], 24, 11
        )
        body += pin.translate((x, y, 0))
    window = [(28, -14, 5), (47, -17, 5), (47, 17, 5), (28, 14, 5)]
    for i in range(3):
        body -= extruded(rounded(window), -40, 0).rotate((0, 0, 60 + 120 * i))
    return body


def bearing_cover() -> Solid:
    """A bearing cover: a plate of 88 mm with four ears, a spigot and a hole for the shaft."""
    plate = turned([(14, -10), (44, -10), (44, 0, 1.5), (14, 0)], 44, 11)
    for x, y in ring_of(4, 43.0, 45.0):
        plate += cylinder(9.5, -10, 0, 32, x, y)
    plate += turned([(24, -1), (34, -1), (34, 14, 1.5), (27, 14, 1.5), (27, -1)], 44, 11)
    plate += turned([(14, -22, 1), (22, -22, 1.5), (25, -9), (14, -9)], 44, 11)
    for x, y in ring_of(4, 43.0, 45.0):
        plate -= cylinder(4.5, -30, 20, 24, x, y)
    return plate.translate((0, 0, 4))


def bracket() -> Solid:
    """An angle bracket, 90 x 64 x 82 mm: a foot with four holes, a bearing eye and two gussets."""
    foot = block((90, 64, 10), (0, 0, -36), fillet=10)
    upright = rounded([(-24, -36), (24, -36), (22, 19), (-22, 19)])
    wall = extruded(upright, -7, 7).rotate((90, 0, 0)).translate((0, -20, 0))
    eye = cylinder(22, -13, 13, 56).rotate((90, 0, 0)).translate((0, -17, 19))
    gusset = extruded(rounded([(-14, -33), (26, -33), (26, -28), (-14, 4)]), -4, 4)
    gusset = gusset.rotate((90, 0, 90))
    body = foot + wall + eye
    for x in (-18.0, 18.0):
        body += gusset.translate((x, 0, 0))
    body -= cylinder(13, -40, 40, 48).rotate((90, 0, 0)).translate((0, 0, 19))
    for x in (-35.0, 35.0):
        for y in (-20.0, 20.0):
            body -= cylinder(4.5, -60, 0, 24, x, y)
    return body


def coupling_hub() -> Solid:
    """One half of a jaw coupling: 64 mm across, three jaws, a keyed bore of 24 mm."""
    body = turned([(0, -30, 0), (24, -30, 1.5), (24, -8), (32, -8, 1.5), (32, 12), (0, 12)], 44, 11)
    ring = turned([(16, 11), (32, 11), (32, 30, 1.2), (16, 30, 1.2)], 44, 11)
    half = np.deg2rad(29.0)
    wedge = [(0.0, 0.0), (60.0, -60.0 * np.tan(half)), (60.0, 60.0 * np.tan(half))]
    for i in range(3):
        jaw = extruded(np.array(wedge), 0, 40).rotate((0, 0, 120.0 * i))
        body += ring ^ jaw
    bore = cylinder(12, -40, 40, 48) + block((10, 7, 90), (10.4, 0, 0))
    return body - bore
