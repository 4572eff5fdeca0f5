"""Faces without area leave closed surfaces closed, and every solid as it was."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from gpis_grasp_planner.geometry.mass_properties import signed_volume
from gpis_grasp_planner.geometry.slivers import altitudes, without_slivers
from gpis_grasp_planner.geometry.topology import find_edges


def ball():
    solid = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    return np.asarray(solid.vertices), np.asarray(solid.faces, dtype=np.int32)


def with_cap(vertices, faces, edge, share):
    """Split one face at a point of an edge, and close the gap to the other by a cap."""
    u, v = edge
    owner = next(
        i for i, f in enumerate(faces.tolist()) if (u, v) in zip(f, f[1:] + f[:1], strict=True)
    )
    [w] = set(faces[owner].tolist()) - {u, v}
    new = len(vertices)
    vertices = np.vstack([vertices, (1 - share) * vertices[u] + share * vertices[v]])
    split = [(u, new, w), (new, v, w), (v, new, u)]
    return vertices, np.vstack([np.delete(faces, owner, axis=0), split]).astype(np.int32)


def test_altitudes_of_known_triangles():
    vertices = np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0], [1, 0, 0]])
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 0, 1]], dtype=np.int32)
    np.testing.assert_allclose(altitudes(vertices, faces), [12 / 5, 0, 0], atol=1e-15)


def test_caps_anywhere_are_turned_into_their_neighbours(rng):
    vertices, faces = ball()
    before = signed_volume(vertices[faces])
    for _ in range(60):
        face = faces[rng.integers(len(faces))]
        k = rng.integers(3)
        vertices, faces = with_cap(
            vertices, faces, (face[k], face[(k + 1) % 3]), rng.uniform(0.2, 0.8)
        )
    assert (altitudes(vertices, faces) < 1e-8).sum() >= 60
    found, left_out = without_slivers(vertices, faces, 1e-8)
    assert left_out == 0
    edges = find_edges(found)
    assert edges.closed
    assert set(edges.uses) == {2}
    assert altitudes(vertices, found).min() > 1e-8
    assert signed_volume(vertices[found]) == pytest.approx(before, rel=1e-7)


def test_needles_are_joined(rng):
    vertices, faces = ball()
    before = signed_volume(vertices[faces])
    for v in rng.permutation(len(vertices))[:20]:
        # The faces round v are shared out between v and a twin next to it; needles fill the slit.
        around = np.flatnonzero((faces == v).any(axis=1))
        first = around[0]
        after = [int(np.roll(faces[i], -int(np.argmax(faces[i] == v)))[1]) for i in around]
        twin = len(vertices)
        vertices = np.vstack([vertices, vertices[v] + 1e-9])
        a = after[0]
        [b] = set(faces[first].tolist()) - {v, a}
        faces = faces.copy()
        faces[first][faces[first] == v] = twin
        faces = np.vstack([faces, [(v, a, twin), (v, twin, b)]]).astype(np.int32)
    assert find_edges(faces).closed
    found, left_out = without_slivers(vertices, faces, 1e-8)
    assert left_out == 0
    assert find_edges(found).closed
    assert len(found) == len(ball()[1])
    assert signed_volume(vertices[found]) == pytest.approx(before, rel=1e-6)


def test_a_cap_at_the_rim_has_no_neighbour_and_is_left_out():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0, 0]])
    faces = np.array([[0, 3, 2], [3, 1, 2], [1, 3, 0]], dtype=np.int32)
    found, left_out = without_slivers(vertices, faces, 1e-9)
    assert left_out == 1
    np.testing.assert_array_equal(found, faces[:2])


def test_sound_faces_pass_untouched():
    vertices, faces = ball()
    found, left_out = without_slivers(vertices, faces, 1e-8)
    assert found is faces
    assert left_out == 0


def test_a_cap_beside_faces_with_a_corner_twice_is_taken_out():
    """As an exporter writes them that rounds its vertices: the line was taken for a neighbour."""
    vertices, faces = ball()
    u, v, _ = faces[0]
    vertices, faces = with_cap(vertices, faces, (u, v), 0.5)
    lines = np.array([(u, v, v), (v, u, u)], dtype=np.int32)
    found, left_out = without_slivers(vertices, np.vstack([faces[-1:], lines, faces[:-1]]), 1e-8)
    assert left_out == 0
    assert set(find_edges(found).uses) == {2}
