"""Attempts with their imbalance: the same attempts, worth less where hands push the part along."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from gpis_grasp_planner.grasp.balanced_evaluator import BalancedEvaluator
from gpis_grasp_planner.grasp.evaluator import AttemptStatus, PostureEvaluator
from gpis_grasp_planner.grasp.open_hand import open_postures
from gpis_grasp_planner.quality.balance_factor import balance_factor
from gpis_grasp_planner.quality.closing_balance import ClosingBalance
from gpis_grasp_planner.quality.objective import EpsilonVolume
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.search.searches import make_search


@pytest.fixture(scope="module")
def pair(planner, sphere):
    """The plain evaluator of the ball, and the one that asks for the balance."""
    prepared = planner.prepare(sphere)
    plain = CompiledEvaluator(
        planner.hand, sphere, sphere.friction, planner.settings.scene, prepared.field, prepared.tree
    )
    balance = ClosingBalance(
        planner.hand, sphere.center_of_mass, sphere.max_radius, 0.67, 15.0, 20.0, 1.5
    )
    return plain, BalancedEvaluator(plain, balance)


@pytest.fixture(scope="module")
def poses(planner, sphere, make_context, pair):
    """Poses and spreads of a hundred attempts at the ball, good and bad."""
    context = make_context(sphere, seed=3, evaluator=pair[0])
    search = make_search("random-adaption", context)
    while len(context.archive) < 40:
        search.step()
    candidates = context.archive.best(60, 0.05)
    T = np.stack([c.T_object_palm for c in candidates])
    moved = T.copy()
    moved[:, :3, 3] += 0.02 * moved[:, :3, 0]
    spread = np.array([c.preshape for c in candidates])
    return np.concatenate([T, moved]), np.concatenate([spread, spread])


@pytest.mark.parametrize("way", ["attempt", "attempt_from"])
def test_attempts_are_the_plain_ones_with_an_imbalance(planner, pair, poses, way):
    plain, balanced = pair
    assert isinstance(balanced, PostureEvaluator)
    T, spread = poses
    how = spread if way == "attempt" else open_postures(planner.hand, spread)
    before, after = getattr(plain, way)(T, how), getattr(balanced, way)(T, how)
    for field in fields(before):
        if field.name != "imbalance" and getattr(before, field.name) is not None:
            np.testing.assert_array_equal(getattr(before, field.name), getattr(after, field.name))
    closed = (after.status == AttemptStatus.GRASPED) & (after.epsilon > 0.0)
    assert 10 < closed.sum() < len(T)
    assert (after.imbalance[~closed] == 0.0).all()
    assert (after.imbalance[closed] < 1e-9).any()
    assert (after.imbalance[closed] > 0.5).any()


def test_the_objective_is_less_by_the_factor(pair, poses):
    plain, balanced = pair
    before, after = plain.attempt(*poses), balanced.attempt(*poses)
    expected = before.objective(EpsilonVolume(0.5)) * balance_factor(after.imbalance)
    np.testing.assert_allclose(after.objective(EpsilonVolume(0.5)), expected, rtol=1e-12)
    assert (after.objective(EpsilonVolume(0.5)) < before.objective(EpsilonVolume(0.5))).any()


def test_counts_are_those_of_the_evaluator_below(pair, poses):
    plain, balanced = pair
    before = plain.n_attempts
    balanced.attempt(*poses)
    assert balanced.n_attempts == plain.n_attempts == before + len(poses[0])
    assert balanced.n_states == plain.n_states
    assert balanced.friction == plain.friction
