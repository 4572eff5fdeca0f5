"""The lowest of many numbers, against a plain search."""

import numpy as np
import pytest

from gpis_grasp_planner.lanes import LANES, filled, lowest_along, nearest_stop


def columns_of(points):
    """Points (n, d) as columns with room, and how many there are with what fills the lanes."""
    n, d = points.shape
    columns = np.full((d, n + LANES), np.nan)
    columns[:, :n] = points.T
    return columns, filled(columns, n)


@pytest.mark.parametrize("d", [1, 3, 6])
def test_lowest_along_is_the_first_of_the_smallest_products_to_the_bit(d, rng):
    for n in [*range(1, 40), 64, 116]:
        # few different numbers: many are equal
        points = rng.integers(-2, 3, size=(n, d)) * 0.1
        direction = tuple((rng.integers(-2, 3, size=d) * 0.3).tolist())
        columns, full = columns_of(points)
        heights = points[:, 0] * direction[0]
        for c in range(1, d):
            heights = heights + points[:, c] * direction[c]
        index, value = lowest_along(columns, full, direction)
        assert index == np.argmin(heights)
        assert value == heights[index]


def test_what_fills_the_lanes_is_the_last_point_and_nothing_else_changes(rng):
    points = rng.normal(size=(11, 3))
    columns, full = columns_of(points)
    assert full == 16
    np.testing.assert_array_equal(columns[:, :11], points.T)
    np.testing.assert_array_equal(columns[:, 11:16], np.repeat(points[-1:], 5, axis=0).T)
    assert np.isnan(columns[:, 16:]).all()


def test_nearest_stop_is_the_first_constraint_on_the_way(rng):
    for n in (7, 8, 30, 61):
        points = rng.normal(size=(n, 6))
        columns, full = columns_of(points)
        slack = np.full(full, np.inf)
        slack[:n] = rng.choice([0.0, 0.5, 1.0, np.inf], n)
        direction = rng.normal(size=6)
        rates = np.full(full, np.nan)
        index, way = nearest_stop(columns, full, tuple(direction.tolist()), slack, rates)
        np.testing.assert_allclose(rates[:n], points @ direction, atol=1e-12)
        with np.errstate(divide="ignore"):
            ways = np.where(rates > 1e-11, slack / rates, np.inf)
        assert way == ways.min()
        assert index == np.argmin(ways)


def test_nothing_stops_where_no_constraint_is_used_up():
    columns, full = columns_of(-np.ones((9, 6)))
    rates = np.empty(full)
    index, way = nearest_stop(columns, full, (1.0,) * 6, np.ones(full), rates)
    assert (index, way) == (0, np.inf)
    assert (rates == -6.0).all()
