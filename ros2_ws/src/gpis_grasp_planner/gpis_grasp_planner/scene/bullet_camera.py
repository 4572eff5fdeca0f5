"""Coloured meshes as PyBullet's software renderer (TinyRenderer) sees them: no screen, no GPU.

There is no physics here: bodies are shapes to be looked at.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.scene.bullet_world import bullet_client, pybullet

Array = NDArray[np.float64]

# PyBullet takes 131,072 vertices a shape, and a triangle has three of its own here.
_MOST_TRIANGLES = 40_000
_KEY_DIRECTION = np.array([-0.45, 0.65, 0.75])  # to the light, in the camera's right, up, back
_AMBIENT, _DIFFUSE, _SPECULAR = 0.6, 0.45, 0.1
_SHINE = (0.1, 0.1, 0.1)


@dataclass(frozen=True, eq=False)
class Shot:
    """What a camera sees.

    Attributes
    ----------
    pixels : (h, w, 3) uint8 array
    depth : (h, w) array [m]
        Along the camera's axis; inf where nothing is seen.
    body : (h, w) int array
        Index of the body, -1 where nothing is seen.
    """

    pixels: NDArray[np.uint8]
    depth: Array
    body: NDArray[np.int64]


class BulletCamera:
    """Takes shots of bodies; a context manager that frees them."""

    def __init__(self) -> None:
        self._owned = ExitStack()
        self._client = self._owned.enter_context(bullet_client())
        self._body_of: dict[int, int] = {}
        self._corners: list[Array] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._owned.close()

    def add(self, corners: Array, normals: Array, color: tuple[float, float, float]) -> None:
        """Add a body; its index is how many there were before.

        Parameters
        ----------
        corners, normals : (m, 3, 3) arrays
            Of the triangles, in the world frame; [m], and outward unit vectors.
        color : (3,) tuple
            Red, green, blue in 0..1.
        """
        index = len(self._corners)
        self._corners.append(corners)
        for first in range(0, len(corners), _MOST_TRIANGLES):
            vertices = corners[first : first + _MOST_TRIANGLES].reshape(-1, 3)
            shape = self._client.createVisualShape(
                pybullet.GEOM_MESH,
                vertices=vertices.tolist(),
                indices=list(range(len(vertices))),
                normals=normals[first : first + _MOST_TRIANGLES].reshape(-1, 3).tolist(),
                uvs=[[0.0, 0.0]] * len(vertices),
                rgbaColor=[*color, 1.0],
                specularColor=_SHINE,
            )
            number = self._client.createMultiBody(0.0, -1, shape)
            self._body_of[number] = index

    def shot(
        self,
        T_world_camera: Array,
        fov_deg: float,
        width: int,
        height: int,
        *,
        shadows: bool = True,
    ) -> Shot:
        """See the bodies from a pose (x right, y up, z back); `fov_deg` is vertical.

        About 8 ms for 96 x 72 pixels of a hand without shadows, 1 s for 2000 x 1500 with them.
        """
        near, far = self._range(T_world_camera)
        R, center = T_world_camera[:3, :3], T_world_camera[:3, 3]
        projection = self._client.computeProjectionMatrixFOV(fov_deg, width / height, near, far)
        _, _, pixels, z, number = self._client.getCameraImage(
            width,
            height,
            self._client.computeViewMatrix(center, center - R[:, 2], R[:, 1]),
            projection,
            lightDirection=R @ _KEY_DIRECTION,
            lightAmbientCoeff=_AMBIENT,
            lightDiffuseCoeff=_DIFFUSE,
            lightSpecularCoeff=_SPECULAR,
            shadow=int(shadows),
            renderer=pybullet.ER_TINY_RENDERER,
        )
        number = np.asarray(number, dtype=np.int64).reshape(height, width)
        body = np.full((height, width), -1, dtype=np.int64)
        for known, index in self._body_of.items():
            body[number == known] = index
        z = np.asarray(z, dtype=float).reshape(height, width)
        depth = np.where(body < 0, np.inf, far * near / (far - (far - near) * z))
        colors: Any = np.asarray(pixels, dtype=np.uint8).reshape(height, width, 4)
        return Shot(colors[..., :3], depth, body)

    def _range(self, T_world_camera: Array) -> tuple[float, float]:
        """Nearest and farthest distance of the bodies along the camera's axis [m]."""
        if not self._corners:
            return 0.1, 1.0
        axis, center = -T_world_camera[:3, 2], T_world_camera[:3, 3]
        along = [(corners.reshape(-1, 3) - center) @ axis for corners in self._corners]
        near, far = min(map(np.min, along)), max(map(np.max, along))
        return float(max(0.98 * near, 1e-3)), float(1.02 * far + 1e-3)
