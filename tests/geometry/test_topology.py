"""Edges, bodies and winding of meshes with known answers."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.geometry.topology import bodies, faces_to_flip, find_edges

MOEBIUS = np.array([(i, (i + 1) % 5, (i + 2) % 5) for i in range(5)], dtype=np.int32)


def test_a_box_is_closed_and_manifold(write):
    _, faces = write.box_arrays()
    edges = find_edges(faces)
    assert len(edges.uses) == 18  # Euler: 8 - 18 + 12 = 2
    assert edges.closed
    assert edges.open == edges.non_manifold == 0
    assert edges.agree.all()
    assert {tuple(sorted(p)) for p in edges.pairs.tolist()} == {
        tuple(sorted((i, j)))
        for i in range(12)
        for j in range(i)
        if len(set(faces[i]) & set(faces[j])) == 2
    }
    for (a, b), (i, j) in zip(edges.ends, edges.pairs, strict=True):
        assert {a, b} == set(faces[i]) & set(faces[j])


def test_a_missing_face_leaves_three_open_edges(write):
    _, faces = write.box_arrays()
    edges = find_edges(faces[1:])
    assert edges.open == 3
    assert not edges.closed


def test_two_boxes_sharing_an_edge_are_closed_but_not_manifold(write):
    _, faces = write.box_arrays()
    other = faces + 8
    other[other == 8] = 0
    other[other == 9] = 1  # the edge from corner 0 to corner 1 is shared
    edges = find_edges(np.vstack([faces, other]))
    assert edges.closed
    assert edges.non_manifold == 1
    assert bodies(np.vstack([faces, other]))[0] == 1


def test_bodies_are_counted_and_labelled(write):
    _, faces = write.box_arrays()
    count, label = bodies(np.vstack([faces, faces + 8, faces + 16]))
    assert count == 3
    assert [len(set(label[12 * i : 12 * i + 12])) for i in range(3)] == [1, 1, 1]
    assert len(set(label)) == 3


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.9])
def test_flipping_makes_any_disorder_consistent(share, write, rng):
    _, faces = write.box_arrays()
    faces = np.vstack([faces, faces + 8])
    disorder = rng.random(24) < share
    faces[disorder] = faces[disorder][:, ::-1]
    edges = find_edges(faces)
    flip, one_sided = faces_to_flip(edges, 24)
    assert not one_sided.any()
    faces[flip] = faces[flip][:, ::-1]
    assert find_edges(faces).agree.all()
    for body in (slice(0, 12), slice(12, 24)):
        assert flip[body].sum() == min(disorder[body].sum(), 12 - disorder[body].sum())


def test_a_moebius_strip_cannot_be_oriented():
    edges = find_edges(MOEBIUS)
    flip, one_sided = faces_to_flip(edges, 5)
    assert one_sided.all()
    assert not flip.any()
