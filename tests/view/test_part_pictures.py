"""What is coloured is cut finely enough, and is still the part; a legend is beside a picture."""

import numpy as np
import pytest

from gpis_grasp_planner.hand.link_mesh import convex_hull
from gpis_grasp_planner.view.legend import with_legend
from gpis_grasp_planner.view.part_pictures import _balls, _from_blue_to_red, _subdivided

BOX = convex_hull([[x, y, z] for x in (0.0, 0.1) for y in (0.0, 0.02) for z in (0.0, 0.03)])


@pytest.mark.parametrize("longest_m", [1.0, 0.03, 0.004])
def test_cut_triangles_are_short_and_cover_the_same(longest_m):
    fine = _subdivided(BOX, longest_m)
    corners = fine.vertices[fine.faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    assert edges.max() <= longest_m
    assert fine.face_areas.sum() == pytest.approx(BOX.face_areas.sum())
    # The integral of the outward normal times x over a closed surface is its volume.
    flux = fine.face_areas @ (fine.face_normals_outward * corners.mean(axis=1)).sum(axis=1) / 3.0
    assert flux == pytest.approx(0.1 * 0.02 * 0.03)


def test_balls_are_where_they_should_be(rng):
    centers = rng.uniform(-1.0, 1.0, (5, 3))
    balls = _balls(centers, 0.01)
    corners = balls.vertices.reshape(5, -1, 3)
    np.testing.assert_allclose(np.linalg.norm(corners - centers[:, None], axis=2), 0.01, atol=1e-12)
    of_ball = balls.faces // corners.shape[1]
    assert (of_ball == of_ball[:, :1]).all()
    assert np.bincount(of_ball[:, 0]).tolist() == [len(balls.faces) // 5] * 5


def test_colours_go_from_blue_by_grey_to_red():
    blue, grey, red = (np.array(_from_blue_to_red(share)) for share in (-1.0, 0.0, 1.0))
    assert blue.argmax() == 2
    assert np.ptp(grey) < 10
    assert red.argmax() == 0


def test_a_legend_is_beside_the_picture_and_has_a_dot_of_each_colour(rng):
    pixels = rng.integers(0, 255, (120, 80, 3)).astype(np.uint8)
    entries = [((200, 10, 10), "one"), ((10, 10, 200), "another, longer")]
    made = with_legend(pixels, "title", entries)
    np.testing.assert_array_equal(made[:, :80], pixels)
    column = made[:, 80:].astype(int)
    rows = [np.flatnonzero((column == color).all(axis=2).any(axis=1)) for color, _ in entries]
    assert min(map(len, rows)) > 3
    assert rows[0].max() < rows[1].min()
    assert (column[:, -2:] == 255).all()  # the longest text has room
