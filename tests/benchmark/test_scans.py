"""Scans: what the camera sees of a ball is its near side, as much as was asked for, with noise."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_benchmark.scans import DISTANCE_M, scan
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory

CATALOGUE = MeshCatalogue([default_catalogue_directory()])


@pytest.mark.parametrize("share", [0.5, 0.75])
def test_the_share_is_seen_from_one_or_two_viewpoints(share, seed):
    made = scan(CATALOGUE.load("bracket").mesh, share, 0.001, seed)
    assert made.share == pytest.approx(share, abs=0.04)
    assert len(made.viewpoints) in (1, 2)
    again = scan(CATALOGUE.load("bracket").mesh, share, 0.001, seed)
    np.testing.assert_array_equal(made.points, again.points)


def test_a_point_of_a_ball_is_seen_where_it_faces_a_viewpoint(seed):
    made = scan(CATALOGUE.load("sphere").mesh, 0.5, 0.0, seed)
    r = np.linalg.norm(made.points, axis=1)
    np.testing.assert_allclose(r, 0.035, atol=3e-4)  # of a polyhedron
    np.testing.assert_allclose(np.linalg.norm(made.viewpoints, axis=1), DISTANCE_M, rtol=1e-6)
    cosine = (made.points / r[:, None]) @ made.viewpoints.T / DISTANCE_M
    assert (cosine.max(axis=1) > 0.035 / DISTANCE_M - 0.06).all()


def test_the_noise_is_along_all_axes_and_all_is_seen_at_a_share_of_one(seed):
    mesh = CATALOGUE.load("mug").mesh
    exact, noisy = (scan(mesh, 1.0, noise, seed) for noise in (0.0, 0.001))
    assert exact.share == 1.0
    np.testing.assert_allclose((noisy.points - exact.points).std(axis=0), 0.001, rtol=0.05)
