"""Symmetries that a part nearly has: reflections, half-turns and the inversion in its centre.

Only principal axes of inertia can be normals of planes of symmetry or axes of half-turns. Where
two or three principal moments are nearly equal there is a circle or a sphere of such axes, and
directions all over it are tried. Turns by other angles are left out: where there are any there
are nearly always planes as well, whose reflections lead to as many places.

"Nearly" is meant: what is found is used to propose grasps, which are then closed on the part as it
is. A mug is worth trying as a turned part, its handle notwithstanding.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.surface.atlas import SurfaceAtlas

Array = NDArray[np.float64]

_NEARLY_EQUAL = 1.15
_CIRCLE, _SPHERE = 24, 60
_POINTS = 250
_APART_RAD = np.deg2rad(15.0)


@dataclass(frozen=True, eq=False)
class NearSymmetry:
    """A map of the part nearly onto itself.

    Attributes
    ----------
    T_image_object : (4, 4) array
        In the object's frame; a reflection has the determinant -1.
    residual : float
        Mean distance of the surface's image from the surface, over the part's largest radius.
    """

    T_image_object: Array
    residual: float

    @property
    def is_reflection(self) -> bool:
        """Whether left and right are exchanged."""
        return bool(np.linalg.det(self.T_image_object[:3, :3]) < 0.0)


def near_symmetries(
    atlas: SurfaceAtlas, center: Array, max_radius: float, tolerance: float, most: int = 24
) -> tuple[NearSymmetry, ...]:
    """Symmetries about `center` with a residual within the tolerance, best first.

    Parameters
    ----------
    atlas : SurfaceAtlas
    center : (3,) array [m]
        Centre of mass.
    max_radius : float [m]
        Largest distance of the surface from it.
    tolerance : float
        Largest residual.
    most : int
        No more than this; of two less than 15 degrees apart the better one is kept.

    Notes
    -----
    5 to 30 ms.
    """
    points = atlas.points - center
    # Evenly strided: the samples come ordered along the surface, and a draw would need a seed.
    sample = points[np.linspace(0, len(points) - 1, min(_POINTS, len(points))).astype(np.intp)]
    half_turns = [2.0 * np.outer(axis, axis) - np.eye(3) for axis in _axes(points)]
    found = []
    for R in (-np.eye(3), *half_turns, *(-turn for turn in half_turns)):
        image = sample @ R.T + center
        distance = np.linalg.norm(image - atlas.nearest(image)[1], axis=1)
        residual = float(distance.mean() / max_radius)
        if residual <= tolerance:
            T = np.eye(4)
            T[:3, :3], T[:3, 3] = R, center - R @ center
            found.append(NearSymmetry(T, residual))
    found.sort(key=lambda symmetry: symmetry.residual)
    return _apart(found, most)


def _axes(points: Array) -> Iterable[Array]:
    """Unit vectors (3,) that may be axes of symmetry of points (n, 3) about the origin."""
    moments, axes = np.linalg.eigh(points.T @ points / len(points))
    # A part is often drawn along its axes, where the samples' own axes are off by a little.
    yield from np.concatenate([axes.T, np.eye(3)])
    equal = moments[1:] < _NEARLY_EQUAL * moments[:-1]
    if equal.all():
        i = np.arange(_SPHERE) + 0.5
        polar, azimuth = np.arccos(1.0 - i / _SPHERE), np.pi * (1.0 + np.sqrt(5.0)) * i
        x, y = np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth)
        yield from np.stack([x, y, np.cos(polar)], axis=1)
    elif equal.any():
        first = int(np.flatnonzero(equal)[0])
        for angle in np.linspace(0.0, np.pi, _CIRCLE, endpoint=False):
            yield np.cos(angle) * axes[:, first] + np.sin(angle) * axes[:, first + 1]


def _apart(found: list[NearSymmetry], most: int) -> tuple[NearSymmetry, ...]:
    chosen: list[NearSymmetry] = []
    for symmetry in found:
        R = symmetry.T_image_object[:3, :3]
        if len(chosen) < most and not any(
            other.is_reflection == symmetry.is_reflection
            and np.trace(R.T @ other.T_image_object[:3, :3]) > 1.0 + 2.0 * np.cos(_APART_RAD)
            for other in chosen
        ):
            chosen.append(symmetry)
    return tuple(chosen)
