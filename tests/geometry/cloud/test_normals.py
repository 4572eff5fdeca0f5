"""Normals point outward, whoever told the side: the sensor, the file, or nobody."""

from __future__ import annotations

import numpy as np
import pytest
from cloud_shapes import CENTER, box_points, sphere_points

from gpis_grasp_planner.geometry.cloud.normals import outward_normals, points_inward
from gpis_grasp_planner.geometry.cloud.views import View, spacing_of

NOISE = 0.0005
UP = np.array([0.0, 0.0, 0.5])


def views_of(points, viewpoints):
    return [View.of(points, np.asarray(v), spacing_of(points), NOISE) for v in viewpoints]


def right(found, normals):
    return float((np.einsum("ij,ij->i", found.normals_outward, normals) > 0.0).mean())


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_files_own_normals_give_the_side_and_are_turned_where_they_point_inward(rng, sign):
    points, normals = box_points(rng, noise=NOISE)
    found = outward_normals(points, 32, sign * normals, [])
    assert right(found, normals) > 0.98
    assert ("all turned" in found.note) == (sign < 0.0)


def test_without_any_help_all_agree_and_point_outward(rng):
    points, normals = sphere_points(rng, 3000, NOISE)
    found = outward_normals(points, 32, None, [])
    assert right(found, normals) == 1.0
    assert "No viewpoint is known" in found.note


def test_points_that_lie_in_planes_to_the_last_digit_agree_as_well(rng):
    """They agree though they are not triangulated as they are, which takes long for so many."""
    points, normals = box_points(rng, n=20_000)
    found = outward_normals(points, 32, None, [])
    assert right(found, normals) > 0.99


def test_one_viewpoint_decides_what_it_saw(rng):
    points, normals = sphere_points(rng, 3000, NOISE, cap=0.1)
    found = outward_normals(points, 32, None, views_of(points, [CENTER + UP]))
    assert right(found, normals) > 0.99
    assert found.note.endswith("(1 viewpoint given).")


def test_points_that_no_viewpoint_saw_follow_their_neighbours_and_that_is_said(rng):
    points, normals = sphere_points(rng, 4000, NOISE)
    found = outward_normals(points, 32, None, views_of(points, [CENTER + UP]))
    assert right(found, normals) > 0.99
    assert "seen from none of them" in found.note


def test_opposite_viewpoints_each_decide_their_own_side(rng):
    points, normals = sphere_points(rng, 5000, NOISE)
    views = views_of(points, [CENTER + UP, CENTER - UP])
    assert right(outward_normals(points, 32, None, views), normals) > 0.99


def test_inward_is_told_by_the_volume(rng):
    points, normals = box_points(rng)
    assert not points_inward(points, normals)
    assert points_inward(points, -normals)
