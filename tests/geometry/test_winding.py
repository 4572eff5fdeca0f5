"""Winding numbers of boxes, against what inside and outside mean."""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.geometry import winding
from gpis_grasp_planner.geometry.winding import winding_numbers


def test_one_inside_and_zero_outside(write, rng):
    vertices, faces = write.box_arrays((1.0, 1.0, 1.0))
    points = rng.uniform(-1, 1, (500, 3))
    inside = (np.abs(points) < 0.5).all(axis=1)
    np.testing.assert_allclose(winding_numbers(vertices[faces], points), inside, atol=1e-12)
    inverted = vertices[faces[:, ::-1]]
    np.testing.assert_allclose(winding_numbers(inverted, points), -inside.astype(float), atol=1e-12)


def test_two_where_bodies_overlap(write):
    vertices, faces = write.box_arrays((1.0, 1.0, 1.0))
    both = np.concatenate([vertices[faces], vertices[faces] + (0.5, 0, 0)])
    found = winding_numbers(both, np.array([[0.25, 0, 0], [-0.25, 0, 0], [0.75, 0, 0], [2, 0, 0]]))
    np.testing.assert_allclose(found, (2, 1, 1, 0), atol=1e-12)


def test_chunks_change_nothing(write, rng, monkeypatch):
    vertices, faces = write.box_arrays()
    points = rng.uniform(-0.1, 0.1, (37, 3))
    whole = winding_numbers(vertices[faces], points)
    monkeypatch.setattr(winding, "PAIRS_AT_ONCE", 50)
    np.testing.assert_array_equal(winding_numbers(vertices[faces], points), whole)
    assert winding_numbers(vertices[faces], np.zeros((0, 3))).shape == (0,)
