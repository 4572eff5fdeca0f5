"""Surface points lie on the links, look outwards and leave no gaps."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.surface_points import surface_points

FINE, COARSE = 0.005, 0.012


@pytest.fixture(scope="module")
def points():
    return surface_points(load_hand(), FINE, COARSE)


def rows(points, link):
    return slice(points.offsets[link], points.offsets[link + 1])


def heights(piece, p):
    normal = piece.face_normals_outward
    return p @ normal.T - np.einsum("ij,ij->i", normal, piece.triangles[:, 0])


def test_every_point_lies_on_the_surface_of_its_links_union(points):
    for link, pieces in enumerate(load_hand().link_collision):
        p = points.points[rows(points, link)]
        assert (points.links[rows(points, link)] == link).all()
        # Distance to the union: on one piece and inside no other.
        nearest = np.min([heights(piece, p).max(axis=1) for piece in pieces], axis=0)
        np.testing.assert_allclose(nearest, 0.0, atol=1e-7)


def test_normals_are_unit_and_leave_the_link(points):
    np.testing.assert_allclose(np.linalg.norm(points.normals_outward, axis=1), 1.0, atol=1e-12)
    for link, pieces in enumerate(load_hand().link_collision):
        if len(pieces) > 1:
            continue
        step = points.points[rows(points, link)] + 1e-4 * points.normals_outward[rows(points, link)]
        assert (heights(pieces[0], step).max(axis=1) > 3e-5).all()


def test_all_hull_vertices_of_the_fingers_are_in(points):
    hand = load_hand()
    for finger in hand.fingers:
        for link in (finger.inner_link, finger.distal_link):
            tree = cKDTree(points.points[rows(points, link)])
            distance, _ = tree.query(hand.link_collision[link][0].vertices)
            assert distance.max() <= 0.0008  # nearer points are merged


def test_no_place_is_farther_than_the_spacing_allows(points, rng):
    """Random places on the fingers against the nearest point; 1 mm for the cover's own grain."""
    hand = load_hand()
    for finger in hand.fingers:
        for link in (finger.inner_link, finger.distal_link):
            (piece,) = hand.link_collision[link]
            share = piece.face_areas / piece.face_areas.sum()
            face = rng.choice(len(piece.faces), size=2000, p=share)
            weight = rng.dirichlet(np.ones(3), size=2000)
            place = np.einsum("nc,nci->ni", weight, piece.triangles[face])
            distance, _ = cKDTree(points.points[rows(points, link)]).query(place)
            inner_side = piece.face_normals_outward[face, 1] > 0.7
            assert distance[inner_side].max() < FINE + 0.001
            assert distance.max() < COARSE + 0.001


def test_counts_suit_an_inner_loop_and_answers_are_shared(points):
    counts = np.diff(points.offsets)
    assert counts[0] < 500
    assert counts[1:].min() > 80
    assert counts[1:].max() < 250
    assert surface_points(load_hand(), FINE, COARSE) is points
    with pytest.raises(ValueError, match="read-only"):
        points.points[0] = 0.0
