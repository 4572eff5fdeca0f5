"""Directions that are spread evenly."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.geometry.directions import even_directions


@pytest.mark.parametrize("count", [26, 162, 400])
def test_they_are_unit_vectors_spread_evenly(count: int) -> None:
    found = even_directions(count)
    assert found.shape == (count, 3)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(found.mean(axis=0), 0.0, atol=2.0 / count)
    # The next direction is about as far as the side of an equal share of the sphere.
    cosine = found @ found.T - 2.0 * np.eye(count)
    nearest = np.arccos(cosine.max(axis=1))
    share = np.sqrt(4.0 * np.pi / count)
    assert nearest.min() > 0.75 * share
    assert nearest.max() < 1.25 * share
