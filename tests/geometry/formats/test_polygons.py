"""Polygons to triangles: their area, their edges, nothing outside; and those that cannot be."""

from __future__ import annotations

from collections import Counter

import mesh_dialects as d
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.formats.polygons import triangulate


def split(points, polygons):
    corners = np.concatenate([np.asarray(p) for p in polygons])
    counts = np.array([len(p) for p in polygons])
    return triangulate(np.asarray(points, dtype=float), corners, counts, "file")[:2]


def outline_area(flat) -> float:
    x, y = np.asarray(flat, dtype=float).T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def check_split(flat, faces) -> None:
    """Triangles that wind as the outline, sum up to its area, and have its sides as their rim."""
    a, b, c = (np.asarray(flat)[faces[:, i]] for i in range(3))
    u, v = b - a, c - a
    areas = 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(outline_area(flat), rel=1e-9)
    n = len(flat)
    assert len(faces) == n - 2
    directed = Counter((int(f[i]), int(f[(i + 1) % 3])) for f in faces for i in range(3))
    rim = {(i, j) for i, j in directed if (j, i) not in directed}
    assert rim == {(i, (i + 1) % n) for i in range(n)}
    assert set(directed.values()) == {1}


@st.composite
def star_outlines(draw):
    """Simple outlines around the origin, mostly concave, with corners on straight sides."""
    n = draw(st.integers(4, 24))
    radii = draw(st.lists(st.floats(0.2, 3.0), min_size=n, max_size=n))
    angles = 2 * np.pi * (np.arange(n) + draw(st.floats(0, 1))) / n
    flat = np.column_stack([np.cos(angles), np.sin(angles)]) * np.array(radii)[:, None]
    points = []
    for i, p in enumerate(flat):
        points.append(p)
        for k in range(draw(st.sampled_from([0, 0, 0, 1, 2]))):
            points.append(p + (flat[(i + 1) % n] - p) * (k + 1) / 4)
    return np.array(points)


@given(star_outlines(), st.integers(0, 2**32 - 1))
@settings(max_examples=300)
def test_a_simple_outline_in_any_plane_is_filled_exactly(flat, seed):
    turn = Rotation.random(rng=seed).as_matrix()
    points = np.column_stack([flat, np.zeros(len(flat))]) @ turn.T + (5.0, -3.0, 1.0)
    faces, first = split(points, [range(len(flat))])
    check_split(flat, faces)
    assert first.tolist() == [0, len(flat) - 2]


@pytest.mark.parametrize("outline", [d.L_OUTLINE, d.COMB_OUTLINE])
def test_known_concave_outlines(outline):
    points = np.column_stack([np.array(outline, dtype=float), np.zeros(len(outline))])
    for start in range(len(outline)):
        order = np.roll(np.arange(len(outline)), start)
        faces, _ = split(points[order], [range(len(outline))])
        check_split(np.array(outline, dtype=float)[order], faces)


def test_a_spiral_is_filled():
    angles = np.linspace(0, 6 * np.pi, 60)
    outer = np.column_stack([np.cos(angles), np.sin(angles)]) * (1 + angles)[:, None]
    inner = outer[::-1] * ((0.6 + angles) / (1 + angles))[::-1, None]
    flat = np.vstack([outer, inner])
    faces, _ = split(np.column_stack([flat, np.zeros(len(flat))]), [range(len(flat))])
    check_split(flat, faces)


def test_a_hole_joined_by_a_bridge_is_left_open():
    outer = [(0, 0), (9, 0), (9, 9), (0, 9)]
    hole = [(3, 3), (3, 6), (6, 6), (6, 3)]
    flat = np.array([*outer, outer[0], hole[0], *hole[1:], hole[0]], dtype=float)
    points = np.column_stack([flat, np.zeros(len(flat))])
    faces, _ = split(points, [range(len(flat))])
    a, b, c = (flat[faces[:, i]] for i in range(3))
    u, v = b - a, c - a
    areas = 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    assert (areas >= 0).all()
    assert areas.sum() == pytest.approx(81.0 - 9.0)


def test_polygons_of_many_sizes_keep_their_order():
    flat = np.array([(0, 0), (4, 0), (4, 4), (0, 4), (2, 2)], dtype=float)
    points = np.column_stack([flat, np.zeros(5)])
    faces, first = split(
        points, [[0, 1, 4], [0, 1, 2, 3], [1, 2, 4], [0, 1, 2, 4, 3], [2, 3, 3, 4]]
    )
    assert first.tolist() == [0, 1, 3, 4, 7, 8]
    assert faces[0].tolist() == [0, 1, 4]
    assert faces[3].tolist() == [1, 2, 4]
    assert sorted(faces[7].tolist()) == [2, 3, 4]


@pytest.mark.parametrize(
    "flat",
    [
        [(0, 0), (4, 4), (4, 0), (0, 4)],  # a bow tie: no area at all
        [(0, 0), (4, 4), (6, 0), (0, 3)],
        [(0, 0), (10, 0), (10, 10), (5, -5), (0, 10)],
        [(np.cos(a), np.sin(a)) for a in 4 * np.pi * np.arange(5) / 5],  # a pentagram
    ],
)
def test_an_outline_that_crosses_itself_is_refused_by_its_number(flat):
    points = np.column_stack([np.array(flat, dtype=float), np.zeros(len(flat))])
    with pytest.raises(MeshError, match=r"face 2 of \d corners crosses itself") as caught:
        split(points, [[0, 1, 2], range(len(flat))])
    assert caught.value.code == ErrorCode.MESH_DEGENERATE


def test_a_polygon_on_a_line_is_left_for_the_judge():
    points = [(0, 0, 0), (1, 1, 1), (2, 2, 2), (3, 3, 3)]
    faces, _ = split(points, [range(4)])
    assert len(faces) == 2


def test_a_warped_quad_is_split_in_two():
    points = [(0, 0, 0), (1, 0, 0.3), (1, 1, 0), (0, 1, 0.3)]
    faces, _ = split(points, [range(4)])
    assert faces.tolist() == [[0, 1, 2], [0, 2, 3]]


def grid_with_a_bow_tie(size):
    """Quads of one square metre each, 1200 of them, and a bow tie of a side `size` [m]."""
    x, y = np.meshgrid(np.arange(41.0), np.arange(31.0), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])
    at = np.arange(41 * 31).reshape(41, 31)
    quads = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=-1).reshape(-1)
    tie = size * np.array([(0, 0, 0), (1, 1, 0), (1, 0, 0), (0, 1, 0)]) + (0, 0, 5.0)
    corners = np.concatenate([quads, len(points) + np.arange(4)])
    return np.vstack([points, tie]), corners, np.full(1201, 4)


def test_a_small_quad_that_crosses_itself_is_two_triangles_and_noted():
    points, corners, counts = grid_with_a_bow_tie(0.1)
    faces, _, notes = triangulate(points, corners, counts, "file")
    n = len(points)
    assert faces[-2:].tolist() == [[n - 4, n - 3, n - 2], [n - 4, n - 2, n - 1]]
    assert "1 quads that cross themselves (the first is face 1201)" in notes[0]
    assert "0.00083 %" in notes[0]


def test_a_quad_that_crosses_itself_and_makes_up_much_is_refused():
    with pytest.raises(MeshError, match="face 1201 of 4 corners crosses itself"):
        triangulate(*grid_with_a_bow_tie(2.0), "file")
