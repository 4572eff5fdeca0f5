"""A small offscreen ray tracer: coloured meshes in, an image out, with no display or GPU.

Rays are cast by Open3D's ``RaycastingScene`` (Embree). Light: one soft key light with shadows, a
sky with ambient occlusion and a faint highlight. The same scene gives the same pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import open3d as o3d
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.view.soft_light import smooth_light

Array = NDArray[np.float64]
Real = NDArray[np.floating[Any]]
Image = NDArray[np.uint8]

_CREASE_COSINE = np.cos(np.radians(32.0))
_SUBPIXELS = ((0.375, 0.125), (0.875, 0.375), (0.125, 0.625), (0.625, 0.875))  # rotated grid
_KEY_DIRECTION = np.array([-0.45, 0.65, 0.75])  # to the light, in the camera's right, up, back
_KEY_SPREAD = 0.06  # of the light's direction: softness of the shadows
_SHADOW_RAYS, _OCCLUSION_RAYS = 3, 6  # per pixel
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

    def rays(self, width: int, height: int, offset: tuple[float, float]) -> NDArray[np.float32]:
        """Rays (height, width, 6) through the pixels at `offset` within each of them."""
        slope = np.tan(np.radians(self.fov_deg) / 2.0)
        x = ((np.arange(width) + offset[0]) * 2.0 / width - 1.0) * slope * width / height
        y = (1.0 - (np.arange(height) + offset[1]) * 2.0 / height) * slope
        R, center = self.T_world_camera[:3, :3], self.T_world_camera[:3, 3]
        direction = x[None, :, None] * R[:, 0] + y[:, None, None] * R[:, 1] - R[:, 2]
        direction /= np.linalg.norm(direction, axis=2, keepdims=True)
        rays = np.empty((height, width, 6), dtype=np.float32)
        rays[..., :3], rays[..., 3:] = center, direction
        return rays


class Scene:
    """Bodies ready for casting rays."""

    def __init__(self, bodies: Sequence[Body]):
        self._solid = _Group([body for body in bodies if not body.marker])
        self._markers = _Group([body for body in bodies if body.marker])

    def coverage(self, camera: Camera, width: int, height: int) -> NDArray[np.int64]:
        """Index of the solid body each pixel shows, -1 for none, (height, width)."""
        body: NDArray[np.int64] = self._solid.cast(camera.rays(width, height, (0.5, 0.5)))[1]
        return body

    def visible(self, camera: Camera, points: ArrayLike, clearance: float) -> NDArray[np.bool_]:
        """Whether world points (n, 3) are seen, nothing lying `clearance` [m] before them."""
        points = np.asarray(points, dtype=float)
        to_point = points - camera.T_world_camera[:3, 3]
        distance = np.linalg.norm(to_point, axis=1)
        origin = np.broadcast_to(camera.T_world_camera[:3, 3], points.shape)
        rays = np.hstack([origin, to_point / distance[:, None]]).astype(np.float32)
        return np.asarray(self._solid.cast(rays)[0] > distance - clearance)

    def render(self, camera: Camera, width: int, height: int) -> Image:
        """Picture (height, width, 3); about 2.5 s for 1000 x 750 on one core."""
        background = _background(width, height)
        light = self._sampled_light(camera, width, height)
        total = np.zeros((height, width, 3))
        for offset in _SUBPIXELS:
            rays = camera.rays(width, height, offset)
            depth, body, normal = self._solid.cast(rays)
            color = background.copy()
            hit = body >= 0
            color[hit] = self._shade(rays[hit], body[hit], normal[hit], light[hit], camera)
            self._draw_markers(rays, depth, color, camera)
            total += color
        linear = np.clip(total / len(_SUBPIXELS), 0.0, 1.0)
        return np.asarray(np.round(255.0 * linear ** (1.0 / 2.2)), dtype=np.uint8)

    def _sampled_light(self, camera: Camera, width: int, height: int) -> Real:
        """Shares of the key light and of the sky that reach each pixel, (height, width, 2)."""
        rays = camera.rays(width, height, (0.5, 0.5))
        depth, body, normal = self._solid.cast(rays)
        hit = body >= 0
        light = np.zeros((height, width, 2), dtype=np.float32)
        if not hit.any():
            return light
        view = -rays[hit][:, 3:]
        outward = _towards(normal[hit], view).astype(np.float32)
        place = rays[hit][:, :3] - depth[hit, None].astype(np.float32) * view + 1e-4 * outward
        key = _key_direction(camera).astype(np.float32)
        reach = 0.35 * self._solid.diagonal
        rng = np.random.default_rng(1)
        share = np.zeros((len(outward), 2), dtype=np.float32)
        for _ in range(_SHADOW_RAYS):
            noise = rng.standard_normal(outward.shape, dtype=np.float32)
            share[:, 0] += ~self._solid.blocked(place, key + _KEY_SPREAD * noise, np.inf)
        for _ in range(_OCCLUSION_RAYS):
            # A unit normal plus a point of the unit sphere is a cosine-weighted direction.
            noise = _unit(rng.standard_normal(outward.shape, dtype=np.float32))
            share[:, 1] += ~self._solid.blocked(place, _unit(outward + 0.999 * noise), reach)
        light[hit] = share / np.array([_SHADOW_RAYS, _OCCLUSION_RAYS], dtype=np.float32)
        step = 0.012 * self._solid.diagonal
        return smooth_light(light, normal.astype(np.float32), depth, hit, step)

    def _shade(
        self,
        rays: NDArray[np.float32],
        body: NDArray[np.int64],
        normal: Real,
        light: Real,
        camera: Camera,
    ) -> Array:
        view = -rays[:, 3:].astype(float)
        normal = _towards(normal, view)
        key = _key_direction(camera)
        diffuse = light[:, 0] * np.clip(normal @ key, 0.0, None)
        ambient = light[:, 1] * (0.75 + 0.25 * normal @ camera.T_world_camera[:3, 1])
        half_way = _unit(key + view)
        shine = light[:, 0] * np.clip(np.sum(normal * half_way, axis=1), 0.0, None) ** 40
        brightness = 1.05 * diffuse + 0.75 * ambient
        return np.asarray(self._solid.colors[body] * brightness[:, None] + 0.12 * shine[:, None])

    def _draw_markers(
        self, rays: NDArray[np.float32], depth: Real, color: Array, camera: Camera
    ) -> None:
        marker_depth, body, normal = self._markers.cast(rays)
        hit = body >= 0
        if not hit.any():
            return
        facing = np.abs(normal[hit] @ camera.T_world_camera[:3, 2])
        paint = self._markers.colors[body[hit]] * (0.55 + 0.45 * facing[:, None])
        share = np.where(marker_depth[hit] < depth[hit], 1.0, _HIDDEN_MARKER_SHARE)[:, None]
        color[hit] = share * paint + (1.0 - share) * color[hit]


class _Group:
    """Several bodies in one Embree scene, with colours and corner normals."""

    def __init__(self, bodies: Sequence[Body]):
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        self.colors = np.array([body.color for body in bodies]).reshape(-1, 3) ** 2.2
        corners = [_corner_normals(body.mesh) for body in bodies]
        self._corner_normals = np.concatenate(corners) if corners else np.zeros((0, 3, 3))
        self._first_face = np.cumsum([0] + [len(body.mesh.faces) for body in bodies])
        for body in bodies:
            self._scene.add_triangles(
                _tensor(body.mesh.vertices.astype(np.float32)),
                _tensor(body.mesh.faces.astype(np.uint32)),
            )
        if bodies:
            everything = np.vstack([body.mesh.bounds for body in bodies])
            self.diagonal = float(np.linalg.norm(np.ptp(everything, axis=0)))

    def cast(self, rays: NDArray[np.float32]) -> tuple[Real, NDArray[np.int64], Real]:
        """Depth (inf: no hit), body index (-1) and smooth normal for rays (..., 6)."""
        shape = rays.shape[:-1]
        if not len(self.colors):
            return np.full(shape, np.inf), np.full(shape, -1), np.zeros((*shape, 3))
        answer = self._scene.cast_rays(_tensor(rays))
        depth = answer["t_hit"].numpy().astype(float)
        hit = np.isfinite(depth)
        body = np.where(hit, answer["geometry_ids"].numpy().astype(np.int64), -1)
        normal = np.zeros((*shape, 3))
        face = self._first_face[body[hit]] + answer["primitive_ids"].numpy()[hit].astype(np.int64)
        u, v = np.moveaxis(answer["primitive_uvs"].numpy()[hit].astype(float), -1, 0)
        weights = np.column_stack([1.0 - u - v, u, v])
        normal[hit] = _unit(np.einsum("nc,nci->ni", weights, self._corner_normals[face]))
        return depth, body, normal

    def blocked(self, origin: Real, direction: Real, reach: float) -> NDArray[np.bool_]:
        """Whether rays hit anything within `reach` [m]."""
        rays = np.hstack([origin, direction]).astype(np.float32)
        far = float(min(reach, 1e6))
        answer = self._scene.test_occlusions(_tensor(rays), tnear=0.0, tfar=far)
        return np.asarray(answer.numpy())


def _corner_normals(mesh: TriangleMesh) -> Array:
    """Normals (m, 3, 3) at the faces' corners: mean of the neighbours within the crease angle.

    A corner averages those faces around its vertex whose normals lie within 32 deg of its own
    face's, weighted by area, so that round bodies look round and edges stay sharp.
    """
    # Corners at the same place belong together, however the file split its vertices.
    _, vertex = np.unique(mesh.vertices.round(7), axis=0, return_inverse=True)
    corner_vertex = vertex.reshape(-1)[mesh.faces].reshape(-1)
    n_corners, n_vertices = len(corner_vertex), int(corner_vertex.max()) + 1
    at_vertex = csr_array(
        (np.ones(n_corners), (np.arange(n_corners), corner_vertex)), shape=(n_corners, n_vertices)
    )
    corner, other = (at_vertex @ at_vertex.T).nonzero()
    unit, area = mesh.face_normals_outward, mesh.face_areas
    cosine = np.einsum("ij,ij->i", unit[corner // 3], unit[other // 3])
    corner, other = corner[cosine > _CREASE_COSINE], other[cosine > _CREASE_COSINE]
    total = np.zeros((n_corners, 3))
    np.add.at(total, corner, unit[other // 3] * area[other // 3, None])
    return np.asarray(_unit(total).reshape(-1, 3, 3), dtype=float)


def _key_direction(camera: Camera) -> Array:
    return np.asarray(camera.T_world_camera[:3, :3] @ _unit(_KEY_DIRECTION))


def _towards(normal: Real, view: Real) -> Real:
    """Normals (n, 3) turned to the side of the viewer; a mesh may be open or inside out."""
    return np.where(np.sum(normal * view, axis=1, keepdims=True) < 0.0, -normal, normal)


def _tensor(array: NDArray[Any]) -> o3d.core.Tensor:
    return o3d.core.Tensor.from_numpy(np.ascontiguousarray(array))


def _background(width: int, height: int) -> Array:
    """A light grey that darkens downwards, linear colour (height, width, 3)."""
    row = np.linspace(0.93, 0.66, height)[:, None, None]
    return np.asarray(np.broadcast_to(row * np.array([0.97, 0.99, 1.0]), (height, width, 3)))


def _unit(vectors: Real) -> Real:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-12))
