"""A cover on disk comes back as it was; another tolerance or field is another entry."""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.disk_cache import CacheSettings
from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.plan.kept_cover import KeptCover
from gpis_grasp_planner.verification.convex_cover import ConvexCover


def test_a_cover_comes_back_as_it_was(catalogue, tmp_path):
    mesh = catalogue.load("bracket").mesh
    field, tree = DistanceField.of(mesh), TriangleTree.of(mesh)
    settings = CacheSettings(directory=str(tmp_path))
    kept = KeptCover(settings, mesh, 2e-4, field.spacing)
    empty = ConvexCover(mesh, field, tree)
    kept.load_into(empty)
    assert not empty.pieces
    made = ConvexCover(mesh, field, tree)
    made.add()
    kept.save(made)
    kept.load_into(empty)
    assert empty.is_complete()
    for one, other in zip(made.pieces, empty.pieces, strict=True):
        np.testing.assert_array_equal(one, other)
    for tolerance, spacing in ((1e-4, field.spacing), (2e-4, 2.0 * field.spacing)):
        other = ConvexCover(mesh, field, tree)
        KeptCover(settings, mesh, tolerance, spacing).load_into(other)
        assert not other.pieces


def test_a_part_of_a_cover_never_takes_the_place_of_more(catalogue, tmp_path):
    mesh = catalogue.load("bracket").mesh
    field, tree = DistanceField.of(mesh), TriangleTree.of(mesh)
    settings = CacheSettings(directory=str(tmp_path))
    x = mesh.triangles.mean(axis=1)[:, 0]
    small, large, found = (ConvexCover(mesh, field, tree) for _ in range(3))
    small.add(x < np.quantile(x, 0.3))
    large.add(x < np.quantile(x, 0.6))
    for cover, expected in ((small, small), (large, large), (small, large)):
        KeptCover(settings, mesh, 2e-4, field.spacing).save(cover)
        KeptCover(settings, mesh, 2e-4, field.spacing).load_into(found)
        assert found.n_covered == expected.n_covered
        assert not found.is_complete()
