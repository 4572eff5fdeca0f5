"""The convex cover: nothing sticks out, and nothing of the surface is missing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree, nearest_point
from gpis_grasp_planner.verification.convex_cover import ConvexCover, convex_cover

TOLERANCE = 2e-4


def cover_of(part: Part) -> tuple[list[np.ndarray], DistanceField, TriangleTree]:
    field, tree = DistanceField.of(part.mesh), TriangleTree.of(part.mesh)
    return convex_cover(part.mesh, field, tree, TOLERANCE), field, tree


def outside(points: np.ndarray, field: DistanceField, tree: TriangleTree) -> np.ndarray:
    """Exact distance of points from the mesh where they are outside, else 0."""
    found = np.zeros(len(points))
    for i in np.flatnonzero(field.value(points) > 0.0):
        x, y, z = points[i]
        found[i], _, _ = nearest_point(
            x, y, z, 0.01, tree.triangles, tree.lower, tree.upper, tree.child, np.empty(3)
        )
    return found


@pytest.mark.parametrize("mesh_id", ["coupling_hub", "bracket"])
def test_pieces_are_the_part_within_tolerance(mesh_id: str, rng: np.random.Generator) -> None:
    part = MeshCatalogue([default_catalogue_directory()]).load(mesh_id)
    pieces, field, tree = cover_of(part)
    hulls = [ConvexHull(piece, qhull_options="QJ") for piece in pieces]
    # Nothing sticks out: points on the pieces' surfaces.
    over = np.concatenate(
        [
            outside(
                np.einsum("fc,fcd->fd", rng.dirichlet([1, 1, 1], len(h.simplices)), p[h.simplices]),
                field,
                tree,
            )
            for p, h in zip(pieces, hulls, strict=True)
        ]
    )
    print(f"{len(pieces)} pieces, stick out by {1e3 * over.max():.2f} mm at most")
    assert over.max() < 6e-4
    assert np.quantile(over, 0.99) < 1.2 * TOLERANCE
    # Nothing is missing: points on the mesh are in a piece, or hardly out of the nearest.
    weights = rng.dirichlet([1, 1, 1], 2000)
    faces = rng.choice(
        len(part.mesh.faces), 2000, p=part.mesh.face_areas / part.mesh.face_areas.sum()
    )
    points = np.einsum("nc,ncd->nd", weights, part.mesh.triangles[faces])
    gap = np.full(len(points), np.inf)
    for hull in hulls:
        height = points @ hull.equations[:, :3].T + hull.equations[:, 3]
        gap = np.minimum(gap, height.max(axis=1))
    print(f"farthest from the pieces {1e3 * gap.max():.3f} mm")
    assert np.quantile(gap, 0.995) < 5e-5
    assert gap.max() < 3e-4


def test_a_convex_part_is_itself(bar: Part) -> None:
    pieces, _, _ = cover_of(bar)
    everything = ConvexHull(np.concatenate(pieces))
    assert everything.volume == pytest.approx(bar.volume, rel=1e-6)
    assert len(pieces) < 12


def test_a_cover_of_patches_is_a_cover_and_what_is_asked_is_covered() -> None:
    part = MeshCatalogue([default_catalogue_directory()]).load("bracket")
    field, tree = DistanceField.of(part.mesh), TriangleTree.of(part.mesh)
    cover = ConvexCover(part.mesh, field, tree, TOLERANCE)
    left = part.mesh.triangles.mean(axis=1)[:, 0] < part.mesh.bounds.mean(axis=0)[0]
    assert cover.add(left)
    n_left = len(cover.pieces)
    assert not cover.add(left)  # nothing is made twice
    assert not cover.is_complete()
    middles = part.mesh.triangles.mean(axis=1)[left]
    hulls = [ConvexHull(piece, qhull_options="QJ") for piece in cover.pieces]
    gap = np.min(
        [(middles @ h.equations[:, :3].T + h.equations[:, 3]).max(axis=1) for h in hulls], axis=0
    )
    assert np.quantile(gap, 0.995) < 5e-5
    assert cover.add()
    assert cover.is_complete()
    assert n_left < len(cover.pieces)
    again = ConvexCover(part.mesh, field, tree, TOLERANCE)
    again.take_arrays(cover.as_arrays())
    assert again.is_complete()
    for one, other in zip(cover.pieces, again.pieces, strict=True):
        np.testing.assert_array_equal(one, other)


def test_what_others_made_is_taken_over_once() -> None:
    """Two processes cover two halves that overlap; a third takes from both and makes the rest."""
    part = MeshCatalogue([default_catalogue_directory()]).load("bracket")
    field, tree = DistanceField.of(part.mesh), TriangleTree.of(part.mesh)
    x = part.mesh.triangles.mean(axis=1)[:, 0]
    covers = [ConvexCover(part.mesh, field, tree, TOLERANCE) for _ in range(3)]
    covers[0].add(x < np.quantile(x, 0.6))
    covers[1].add(x > np.quantile(x, 0.4))
    third = covers[2]
    for cover in covers[:2]:
        third.take(cover.since(0))
    n_taken = len(third.pieces)
    assert len(covers[0].pieces) < n_taken < len(covers[0].pieces) + len(covers[1].pieces)
    for cover in covers[:2]:  # nothing is taken twice
        third.take(cover.since(0))
    assert len(third.pieces) == n_taken
    third.add()
    assert third.is_complete()
    fresh = ConvexCover(part.mesh, field, tree, TOLERANCE)
    fresh.take_arrays(covers[0].as_arrays())
    assert fresh.n_covered == covers[0].n_covered < third.n_covered
    assert not fresh.is_complete()
    assert [len(p.faces) for p in fresh.since(0)] == [len(p.faces) for p in covers[0].since(0)]
    fresh.add()
    assert fresh.is_complete()


def test_making_a_cover_can_be_ended_and_goes_on() -> None:
    part = MeshCatalogue([default_catalogue_directory()]).load("bracket")
    field, tree = DistanceField.of(part.mesh), TriangleTree.of(part.mesh)
    cover = ConvexCover(part.mesh, field, tree, TOLERANCE)
    asked = iter(range(5))
    cover.add(go_on=lambda: next(asked) < 3)
    assert 1 <= len(cover.pieces) <= 3
    cover.add()
    assert cover.is_complete()
