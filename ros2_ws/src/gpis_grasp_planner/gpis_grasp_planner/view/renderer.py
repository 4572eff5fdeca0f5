"""Coloured meshes in, a picture out, with no display or GPU.

Drawn by PyBullet's software renderer (`scene.bullet_camera`); here are smooth normals, twice the
pixels against jagged edges, the background, and markers that show through. The same scene gives
the same pixels. Why this one: ``docs/decisions/renderer.md``.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.scene.bullet_camera import BulletCamera
from gpis_grasp_planner.view.corner_normals import corner_normals

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

_SUBPIXELS = 2  # of each side
_HIDDEN_MARKER_SHARE = 0.45  # how strongly a marker shows through what hides it


@dataclass(frozen=True, eq=False)
class Body:
    """A mesh in the world frame with a colour (r, g, b in 0..1).

    A marker is drawn over the picture: it casts no shadow and shows faintly through what hides it.
    """

    mesh: TriangleMesh
    color: tuple[float, float, float]
    marker: bool = False


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera: `T_world_camera` has x right, y up, z back; `fov_deg` is vertical."""

    T_world_camera: Array
    fov_deg: float = 28.0


class Scene:
    """Bodies that are looked at; a context manager."""

    def __init__(self, bodies: Sequence[Body]):
        self._owned = ExitStack()
        self._solid = self._owned.enter_context(BulletCamera())
        self._markers = self._owned.enter_context(BulletCamera())
        self._has_markers = any(body.marker for body in bodies)
        for body in bodies:
            corners = body.mesh.vertices[body.mesh.faces]
            drawn = self._markers if body.marker else self._solid
            drawn.add(corners, corner_normals(body.mesh), body.color)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._owned.close()

    def coverage(self, camera: Camera, width: int, height: int) -> NDArray[np.int64]:
        """Index of the solid body each pixel shows, -1 for none, (height, width)."""
        T, fov_deg = camera.T_world_camera, camera.fov_deg
        return self._solid.shot(T, fov_deg, width, height, shadows=False).body

    def render(self, camera: Camera, width: int, height: int) -> Image:
        """Picture (height, width, 3); about half a second for 1000 x 750 on one core."""
        T, fov_deg = camera.T_world_camera, camera.fov_deg
        w, h = _SUBPIXELS * width, _SUBPIXELS * height
        solid = self._solid.shot(T, fov_deg, w, h)
        color = np.where((solid.body >= 0)[..., None], solid.pixels, _background(w, h))
        if self._has_markers:
            markers = self._markers.shot(T, fov_deg, w, h, shadows=False)
            in_front = markers.depth < solid.depth
            share = np.where(in_front, 1.0, _HIDDEN_MARKER_SHARE) * (markers.body >= 0)
            color = share[..., None] * markers.pixels + (1.0 - share[..., None]) * color
        cells = color.reshape(height, _SUBPIXELS, width, _SUBPIXELS, 3)
        return np.asarray(np.round(cells.mean(axis=(1, 3))), dtype=np.uint8)


def _background(width: int, height: int) -> Array:
    """A light grey that darkens downwards, (height, width, 3)."""
    row = np.linspace(247.0, 211.0, height)[:, None, None]
    return np.asarray(np.broadcast_to(row * np.array([0.985, 0.995, 1.0]), (height, width, 3)))
