"""Samples lie on the mesh, are spread evenly, and know the sharp edges."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.stats import chi2

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.surface_samples import (
    even_samples,
    near_sharp_edge,
    sharp_edges,
    uniform_samples,
)


@pytest.fixture(scope="module")
def box(write) -> TriangleMesh:
    vertices, faces = write.box_arrays()
    return TriangleMesh(vertices, faces.astype(np.int32))


@pytest.fixture(scope="module")
def mug() -> TriangleMesh:
    return MeshCatalogue([default_catalogue_directory()]).load("mug").mesh


@pytest.mark.parametrize("sampler", [uniform_samples, even_samples])
def test_samples_lie_in_their_faces(sampler, mug, seed):
    samples = sampler(mug, 300, seed)
    assert len(samples) == 300
    a, b, c = (mug.triangles[samples.faces, k] for k in range(3))
    edges = np.stack([b - a, c - a], axis=2)
    weights = np.linalg.pinv(edges) @ (samples.points - a)[..., None]
    back = (edges @ weights)[..., 0] + a
    np.testing.assert_allclose(back, samples.points, atol=1e-12)
    assert (weights > -1e-9).all()
    assert (weights.sum(axis=1) < 1 + 1e-9).all()
    np.testing.assert_array_equal(samples.normals_outward, mug.face_normals_outward[samples.faces])


@pytest.mark.parametrize("sampler", [uniform_samples, even_samples])
def test_equal_seeds_give_equal_samples(sampler, mug, seed):
    one, two, other = sampler(mug, 200, seed), sampler(mug, 200, seed), sampler(mug, 200, seed + 1)
    np.testing.assert_array_equal(one.points, two.points)
    assert not np.array_equal(one.points, other.points)


def test_uniform_samples_follow_the_area(box, seed):
    n = 20_000
    counts = np.bincount(uniform_samples(box, n, seed).faces, minlength=12)
    expected = n * box.face_areas / box.face_areas.sum()
    statistic = ((counts - expected) ** 2 / expected).sum()
    assert statistic < chi2.ppf(0.9999, 11)
    points = uniform_samples(box, n, seed).points
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=5 * 0.02 / np.sqrt(n))


def test_even_samples_keep_their_distance(mug, seed):
    """Closest neighbours on the same side stay half a mean spacing apart; chance gives far less."""
    count = 400
    spacing = np.sqrt(mug.face_areas.sum() / count)

    def nearest(samples) -> np.ndarray:
        lifted = np.c_[samples.points, 0.5 * spacing * samples.normals_outward]
        return cKDTree(lifted).query(lifted, 2)[0][:, 1]

    even, chance = (
        nearest(even_samples(mug, count, seed)),
        nearest(uniform_samples(mug, count, seed)),
    )
    assert even.min() > 0.5 * spacing
    assert even.min() > 5 * chance.min()


def test_even_samples_leave_no_hole(mug, seed):
    """Every point of the surface has a sample of its own side within 1.3 mean spacings."""
    count = 400
    spacing = np.sqrt(mug.face_areas.sum() / count)
    samples, probes = even_samples(mug, count, seed), uniform_samples(mug, 5000, seed + 1)
    tree = cKDTree(np.c_[samples.points, 0.5 * spacing * samples.normals_outward])
    gap, _ = tree.query(np.c_[probes.points, 0.5 * spacing * probes.normals_outward])
    assert gap.max() < 1.3 * spacing


def test_both_sides_of_a_thin_wall_are_sampled(write, seed):
    vertices, faces = write.box_arrays((0.1, 0.1, 0.001))
    plate = TriangleMesh(vertices, faces.astype(np.int32))
    samples = even_samples(plate, 60, seed)
    top = np.count_nonzero(samples.normals_outward[:, 2] > 0.5)
    bottom = np.count_nonzero(samples.normals_outward[:, 2] < -0.5)
    assert min(top, bottom) > 20


def test_the_sharp_edges_of_a_box_are_its_twelve_edges(box):
    segments = sharp_edges(box)
    assert len(segments) == 12  # and not the six diagonals of its sides
    lengths = np.sort(np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1))
    np.testing.assert_allclose(lengths, np.repeat(np.sort(box.extent), 4))
    assert len(sharp_edges(box, 95.0)) == 0


def test_near_sharp_edge_against_the_distance_to_a_box_s_edges(box, rng):
    points = uniform_samples(box, 3000, int(rng.integers(2**31))).points
    margin = np.sort(0.5 * box.extent - np.abs(points), axis=1)  # of a side: 0, then the distance
    for distance in (0.001, 0.005):
        np.testing.assert_array_equal(
            near_sharp_edge(box, points, distance), margin[:, 1] <= distance
        )


def test_a_sphere_has_no_sharp_edge_and_an_open_rim_is_one(box):
    sphere = MeshCatalogue([default_catalogue_directory()]).load("sphere").mesh
    assert not near_sharp_edge(sphere, sphere.vertices, 1.0).any()
    lidless = TriangleMesh(box.vertices, box.faces[2:])
    assert len(sharp_edges(lidless, 95.0)) == 4
