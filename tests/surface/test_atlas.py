"""Nearest points against brute force, and charts made once."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.errors import MeshError
from gpis_grasp_planner.surface.atlas import SurfaceAtlas
from gpis_grasp_planner.surface.implicit_surface import ImplicitSurface


@pytest.fixture(scope="module")
def atlas(shapes):
    return SurfaceAtlas(ImplicitSurface.fit(*shapes.sphere_samples(400, 0.04)))


def test_nearest_against_brute_force(atlas, rng):
    x = 0.06 * rng.normal(size=(200, 3))
    index, points = atlas.nearest(x)
    distance = np.linalg.norm(x[:, None] - atlas.points[None], axis=2)
    np.testing.assert_array_equal(index, distance.argmin(axis=1))
    np.testing.assert_array_equal(points, atlas.points[index])


def test_charts_are_at_their_points_and_made_once(atlas):
    chart = atlas.chart(17)
    np.testing.assert_array_equal(chart.center, atlas.points[17])
    assert atlas.chart(np.int64(17)) is chart


def test_points_of_ones_own(atlas):
    own = SurfaceAtlas(atlas.surface, [[0.04, 0.0, 0.0], [0.0, 0.0, 0.04]])
    index, _ = own.nearest([[0.0, 0.001, 1.0]])
    assert index.tolist() == [1]
    np.testing.assert_allclose(own.chart(1).normal_outward, [0, 0, 1], atol=5e-3)


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.zeros(3), np.zeros((4, 2))])
def test_an_atlas_without_points_is_refused(atlas, points):
    with pytest.raises(MeshError, match="needs points"):
        SurfaceAtlas(atlas.surface, points)
