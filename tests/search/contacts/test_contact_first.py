"""Hands about contacts: where they are put, what they find, and that they learn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.transforms import apply
from gpis_grasp_planner.grasp.constrained_evaluator import ConstrainedEvaluator
from gpis_grasp_planner.grasp.evaluator import AttemptStatus
from gpis_grasp_planner.search.contacts.contact_first import ContactFirst, fitted, turned_onto
from gpis_grasp_planner.surroundings.obstacles import SupportPlane
from gpis_grasp_planner.surroundings.support_constraint import SupportConstraint


@pytest.fixture(scope="module")
def rod(oracle):
    return oracle.make_part("rod", trimesh.creation.cylinder(0.008, 0.16, sections=48))


def test_vectors_are_turned_onto_others(rng):
    start, end = rng.standard_normal((2, 60, 3))
    start /= np.linalg.norm(start, axis=1, keepdims=True)
    end /= np.linalg.norm(end, axis=1, keepdims=True)
    end[:10], end[10:20] = start[:10], -start[10:20]
    R = turned_onto(start, end)
    assert_allclose(np.einsum("nij,nj->ni", R, start), end, atol=1e-12)
    assert_allclose(np.linalg.det(R), 1.0)


def test_points_are_fitted_to_where_they_came_from(rng):
    R = Rotation.random(20, rng=rng).as_matrix()
    points, normals = rng.standard_normal((2, 20, 3, 3))
    points *= 0.05
    shift = rng.standard_normal((20, 1, 3))
    T = fitted(
        points,
        normals,
        np.einsum("nij,nkj->nki", R, points) + shift,
        np.einsum("nij,nkj->nki", R, normals),
    )
    assert_allclose(T[:, :3, :3], R, atol=1e-9)
    assert_allclose(T[:, :3, 3], shift[:, 0], atol=1e-9)


def test_hands_are_put_about_what_is_asked_for(rod, make_context):
    context = make_context(rod, seed=3)
    search = ContactFirst(context)
    attempts, owner = search.attempt(6)
    n_seed = context.settings.contacts.n_seed
    assert 0 < len(attempts) <= 6 * n_seed
    assert len(owner) == len(attempts)
    assert np.bincount(np.unique(owner, return_inverse=True)[1]).max() <= n_seed
    assert len(np.unique(owner)) <= 12
    assert context.evaluator.n_attempts == len(attempts)


def test_most_hands_touch_a_thin_rod_from_both_sides(rod, make_context):
    """Unless its fingers meet each other; and the contacts lie near the middle of the rod."""
    context = make_context(rod, seed=0)
    search = ContactFirst(context)
    attempts = [search.attempt(8)[0] for _ in range(12)]
    status = np.concatenate([a.status for a in attempts])
    contacts = np.concatenate([a.n_contacts for a in attempts])
    assert not (status == AttemptStatus.PALM_COLLISION).any()
    assert (contacts[status != AttemptStatus.SELF_COLLISION] >= 2).mean() > 0.95
    middle = [
        a.positions[i, : a.n_contacts[i], 2].mean()
        for a in attempts
        for i in range(len(a))
        if a.n_contacts[i] >= 2
    ]
    assert np.abs(middle).mean() < 0.04
    assert len(context.archive.best(50)) >= 5


def test_the_same_seed_gives_the_same_hands(rod, make_context):
    def poses(seed):
        search = ContactFirst(make_context(rod, seed=seed))
        return np.concatenate([search.attempt(4)[0].T_object_palm for _ in range(3)])

    first = poses(5)
    assert_allclose(poses(5), first, rtol=0.0, atol=0.0)
    other = poses(6)
    assert other.shape != first.shape or not np.allclose(other, first)


def test_grips_that_are_worth_something_are_drawn_more_often(rod, make_context):
    """Where only hands from one side are worth anything, grips that come from there prevail."""

    def share_from_side(learns):
        context = make_context(rod, seed=1)
        search = ContactFirst(context)
        objective = type(search)._learn

        def learn(cell, _):
            spreads.append(cell)
            worth = np.where(cell % 9 < 3, 1.0, 0.0) if learns else np.ones(len(cell))
            objective(search, cell, worth)

        spreads: list[np.ndarray] = []
        search._learn = learn
        for _ in range(30):
            search.attempt(8)
        return np.mean(np.concatenate(spreads[15:]) % 9 < 3)

    assert share_from_side(True) > 1.3 * share_from_side(False)


def test_what_has_a_volume_and_is_no_grasp_teaches_nothing(rod, make_context):
    context = make_context(rod, seed=1)
    closed = context.evaluator.attempt

    def loose(T_object_palm, preshape):
        made = closed(T_object_palm, preshape)
        return replace(made, epsilon=np.full(len(made), -1.0), volume=np.ones(len(made)))

    context.evaluator.attempt = loose
    search = ContactFirst(context)
    attempts, _ = search.attempt(8)
    assert attempts.objective(context.objective).max() > 0.0
    assert search._tried.sum() == len(attempts)
    assert search._worth.sum() == 0.0


def test_a_flat_part_on_a_table_gets_as_many_hands_as_a_floating_one(make_context, oracle, planner):
    """Of its sets a few in a hundred have hands above the table: more are drawn."""
    slab = oracle.make_part("slab", trimesh.creation.box(extents=(0.07, 0.023, 0.014)))
    table = SupportPlane(np.array([0.0, 0.0, -0.007]), np.array([0.0, 0.0, 1.0]))
    retreat = planner.settings.scene.retreat_m
    constraints = (SupportConstraint(planner.hand, table, 0.003, retreat),)
    context = make_context(slab, seed=0)
    evaluator = ConstrainedEvaluator(context.evaluator, planner.hand, constraints, retreat)
    context = replace(context, evaluator=evaluator, constraints=constraints)
    search = ContactFirst(context)
    wanted = 8 * context.settings.contacts.n_seed
    made = [len(search.attempt(8)[0]) for _ in range(5)]
    assert np.mean(made) > 0.6 * wanted


def test_a_part_wider_than_the_hand_has_no_set(make_context, oracle):
    huge = oracle.make_part("huge", trimesh.creation.box(extents=(0.9, 0.9, 0.9)))
    search = ContactFirst(make_context(huge))
    assert not search.able


def test_a_poses_places_stay_the_hands(rod, make_context):
    """`apply` of a pose that was chosen keeps the palm outside of the part."""
    context = make_context(rod, seed=2)
    attempts, _ = ContactFirst(context).attempt(8)
    faces = np.stack(
        [apply(T, context.T_palm_face[:3, 3][None])[0] for T in attempts.T_object_palm]
    )
    outside = np.hypot(faces[:, 0], faces[:, 1]) > 0.0079
    assert (outside | (np.abs(faces[:, 2]) > 0.0799)).all()
