"""What a page's scene consists of, by layers that are shown and hidden together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.transforms import to_position_quat_xyzw

Array = NDArray[np.float64]
Color = tuple[int, int, int]

_POINT_M = 0.004


class PageNodes:
    """Adds nodes to a viser scene and keeps them by layer.

    Parameters
    ----------
    scene : viser.SceneApi
    layers : sequence of str
    """

    def __init__(self, scene: Any, layers: Sequence[str]) -> None:
        self._scene = scene
        self._nodes: dict[str, list[Any]] = {layer: [] for layer in layers}

    def frame(self, path: str, T: Array | None = None) -> Any:
        """An invisible frame that others hang on; it belongs to no layer."""
        node = self._scene.add_frame(path, show_axes=False)
        if T is not None:
            place(node, T)
        return node

    def mesh(
        self,
        layer: str,
        path: str,
        mesh: TriangleMesh,
        color: Color,
        opacity: float | None = None,
        wireframe: bool = False,
    ) -> None:
        """A mesh of one colour."""
        node = self._scene.add_mesh_simple(
            path,
            mesh.vertices.astype(np.float32),
            mesh.faces.astype(np.uint32),
            color=color,
            opacity=opacity,
            wireframe=wireframe,
            flat_shading=not wireframe,
            side="double",
        )
        self._nodes[layer].append(node)

    def arrows(self, layer: str, path: str, ends: Array, color: Color) -> None:
        """Arrows from `ends[:, 0]` to `ends[:, 1]`, (n, 2, 3) [m]."""
        node = self._scene.add_arrows(
            path,
            ends.astype(np.float32),
            color,
            shaft_radius=0.002,
            head_radius=0.005,
            head_length=0.012,
        )
        self._nodes[layer].append(node)

    def ring(self, layer: str, path: str, points: Array, color: Color) -> None:
        """A closed line through points (n, 3) [m]."""
        lines = np.stack([points, np.roll(points, -1, axis=0)], axis=1)
        node = self._scene.add_line_segments(path, lines, color, thickness=0.0008)
        self._nodes[layer].append(node)

    def points(self, layer: str, path: str, points: Array, color: Color) -> None:
        """Points (n, 3) [m]."""
        node = self._scene.add_point_cloud(
            path, points.astype(np.float32), color, point_size=_POINT_M, point_shape="circle",
            precision="float32",
        )  # fmt: skip
        self._nodes[layer].append(node)

    def clear(self, layer: str) -> None:
        """Take all nodes of a layer away."""
        for node in self._nodes[layer]:
            node.remove()
        self._nodes[layer] = []

    def show(self, visible: Mapping[str, bool]) -> None:
        """Show or hide layers."""
        for layer, seen in visible.items():
            for node in self._nodes[layer]:
                node.visible = seen


def place(node: Any, T: ArrayLike) -> None:
    """Put a node at a pose (4, 4) in its parent."""
    position, quat_xyzw = to_position_quat_xyzw(np.asarray(T))
    node.position = position
    node.wxyz = quat_xyzw[[3, 0, 1, 2]]
