"""Every pair of near vertices is joined, wherever it lies, and small features are not."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from gpis_grasp_planner.geometry.topology import find_edges
from gpis_grasp_planner.geometry.welding import merge_equal, weld


def soup_of(vertices, faces, noise, rng):
    """Each face with corners of its own, moved by up to `noise` of the extent in each direction."""
    soup = vertices[faces].reshape(-1, 3)
    soup = soup + noise * np.ptp(vertices, axis=0).max() * rng.uniform(-1, 1, soup.shape)
    return soup, np.arange(len(soup), dtype=np.int32).reshape(-1, 3)


@pytest.mark.parametrize("noise", [0.0, 1e-9, 1e-7, 2.5e-7, 2e-6])
def test_a_noisy_soup_becomes_a_closed_surface(noise, rng):
    solid = trimesh.creation.torus(0.04, 0.012)
    for _ in range(5):
        soup, faces = soup_of(np.asarray(solid.vertices), np.asarray(solid.faces), noise, rng)
        found, distance = weld(soup, faces, find_edges(faces))
        assert find_edges(found).closed
        assert len(np.unique(found)) == len(solid.vertices)
        assert distance >= noise * 0.1


def test_merge_equal_is_np_unique(rng):
    vertices = rng.integers(-2, 3, (500, 3)).astype(float)
    vertices[::7] *= -0.0
    faces = rng.integers(0, 500, (300, 3))
    merged, index = merge_equal(vertices, faces)
    np.testing.assert_array_equal(merged, np.unique(vertices + 0.0, axis=0))
    np.testing.assert_array_equal(merged[index], vertices[faces])
    assert not np.signbit(merged[merged == 0.0]).any()


def test_a_chain_of_near_vertices_is_a_feature(rng):
    """A rim of hundreds of vertices nearer to each other than the tolerance does not fall in."""
    n = 400
    angle = 2 * np.pi * np.arange(n) / n
    rim = 2e-5 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    vertices = np.vstack([rim, rim + np.array([0, 0, 1.0])])
    i, j = np.arange(n), (np.arange(n) + 1) % n
    faces = np.concatenate([np.stack([i, j, n + j], 1), np.stack([i, n + j, n + i], 1)])
    faces = faces.astype(np.int32)
    found, distance = weld(vertices, faces, find_edges(faces))
    assert found is faces
    assert distance == 0.0


def test_an_open_surface_with_nothing_to_join_stays(write):
    vertices, faces = write.box_arrays()
    faces = faces[2:].astype(np.int32)
    found, distance = weld(vertices, faces, find_edges(faces))
    assert found is faces
    assert distance == 0.0
