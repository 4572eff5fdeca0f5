"""Shapes whose signed distance is known in closed form, sampled, and as meshes."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from gpis_grasp_planner.geometry.mesh import TriangleMesh

BOX_QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def sphere_samples(n, radius, center=(0.0, 0.0, 0.0)):
    """A Fibonacci spiral: nearly even points and their outward normals."""
    i = np.arange(n) + 0.5
    z = 1.0 - 2.0 * i / n
    angle = np.pi * (1.0 + 5.0**0.5) * i
    r = np.sqrt(1.0 - z * z)
    normals = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    return np.asarray(center) + radius * normals, normals


def box_mesh(size, inverted=False):
    """A box about the origin, facing outwards, or inwards where it bounds a hollow."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    faces = [f for a, b, c, d in BOX_QUADS for f in ((a, b, c), (a, c, d))]
    faces = np.array(faces, dtype=np.int32)
    return TriangleMesh((corners - 0.5) * np.asarray(size), faces[:, ::-1] if inverted else faces)


def hollow_box_mesh(size, wall):
    """A closed box with walls of one thickness round a hollow."""
    outer = box_mesh(size)
    inner = box_mesh(np.asarray(size) - 2.0 * wall, inverted=True)
    return TriangleMesh(
        np.concatenate([outer.vertices, inner.vertices]),
        np.concatenate([outer.faces, inner.faces + len(outer.vertices)]),
    )


def cylinder_mesh(radius, height, n=128):
    """A closed cylinder along z about the origin with n flat sides."""
    angle = 2.0 * np.pi * np.arange(n) / n
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    low = np.column_stack([ring, np.full(n, -height / 2)])
    high = np.column_stack([ring, np.full(n, height / 2)])
    poles = [[0.0, 0.0, -height / 2], [0.0, 0.0, height / 2]]
    i, j = np.arange(n), (np.arange(n) + 1) % n
    faces = np.concatenate(
        [
            np.stack([i, j, n + j], axis=1),
            np.stack([i, n + j, n + i], axis=1),
            np.stack([np.full(n, 2 * n), j, i], axis=1),
            np.stack([np.full(n, 2 * n + 1), n + i, n + j], axis=1),
        ]
    )
    return TriangleMesh(np.concatenate([low, high, poles]), faces.astype(np.int32))


def box_distance(points, size):
    """Signed distance to a box about the origin."""
    q = np.abs(points) - 0.5 * np.asarray(size)
    outside = np.linalg.norm(q.clip(0.0), axis=1)
    return outside + q.max(axis=1).clip(max=0.0)


@pytest.fixture(scope="session")
def shapes():
    """The makers of this file."""
    return SimpleNamespace(
        sphere_samples=sphere_samples,
        box_mesh=box_mesh,
        hollow_box_mesh=hollow_box_mesh,
        cylinder_mesh=cylinder_mesh,
        box_distance=box_distance,
    )
