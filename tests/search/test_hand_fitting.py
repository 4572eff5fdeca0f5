"""Searches that know a table: what they close lies above it, and what they find is clear of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gpis_grasp_planner.grasp.constrained_evaluator import ConstrainedEvaluator
from gpis_grasp_planner.grasp.constraint import ClosedHands
from gpis_grasp_planner.grasp.evaluator import AttemptStatus
from gpis_grasp_planner.grasp.funnel import Step
from gpis_grasp_planner.grasp.open_hand import open_postures
from gpis_grasp_planner.hand.drive import joints_from_motors
from gpis_grasp_planner.search.hand_fitting import HandFitting
from gpis_grasp_planner.search.searches import make_search
from gpis_grasp_planner.surroundings.approach_constraint import ApproachConstraint
from gpis_grasp_planner.surroundings.obstacles import SupportPlane
from gpis_grasp_planner.surroundings.support_constraint import SupportConstraint

RADIUS = 0.035
UP = np.array([0.0, 0.0, 1.0])
MARGIN = 0.003


class Closed:
    """Passes on to an evaluator and remembers which palms it was asked to close."""

    def __init__(self, evaluator):
        self._evaluator = evaluator
        self.T, self.joints = [], []

    def __getattr__(self, name):
        return getattr(self._evaluator, name)

    def attempt(self, T_object_palm, spread):
        self.T.append(np.array(T_object_palm))
        self.joints.append(open_postures(self._evaluator.hand, spread))
        return self._evaluator.attempt(T_object_palm, spread)


def constrained(context, planner, constraints):
    closed = Closed(context.evaluator)
    retreat = planner.settings.scene.retreat_m
    evaluator = ConstrainedEvaluator(closed, planner.hand, constraints, retreat)
    return replace(context, evaluator=evaluator, constraints=constraints), closed


@pytest.fixture
def table(planner):
    plane = SupportPlane(np.array([0.0, 0.0, -RADIUS]), UP)
    return SupportConstraint(planner.hand, plane, MARGIN, planner.settings.scene.retreat_m)


@pytest.fixture
def from_above():
    face = np.eye(4)
    face[2, 3] = 0.079
    return ApproachConstraint(-UP, 40.0, face)


@pytest.mark.parametrize("name", ["dual", "hpp", "random", "random-adaption", "annealing"])
def test_no_palm_is_closed_below_the_table(name, planner, sphere, make_context, table):
    context, closed = constrained(make_context(sphere, seed=5), planner, (table,))
    search = make_search(name, context)
    while context.evaluator.n_attempts < 300 and not search.finished:
        search.step()
    if closed.T:  # annealing closes from postures
        assert table.allows_palm(np.concatenate(closed.T), np.concatenate(closed.joints)).all()
    for candidate in context.archive.best(50, 0.01):
        hands = ClosedHands.of(
            planner.hand,
            candidate.attempts,
            np.array([candidate.index]),
            planner.settings.scene.retreat_m,
        )
        assert not table.verdict(hands).blocked.any()


def test_most_of_what_is_proposed_on_a_table_is_closed(planner, sphere, make_context, table):
    """Hands that lack height are lifted: few proposals are lost before the closing."""
    context, closed = constrained(make_context(sphere, seed=6), planner, (table,))
    search = make_search("dual", context)
    while context.evaluator.n_attempts < 600:
        search.step()
    tried = sum(len(T) for T in closed.T)
    assert sum(context.evaluator.tally.funnel(Step.CLEAR).screened.values()) < 0.25 * tried
    assert len(context.archive) > 20


def test_two_constraints_hold_together(planner, sphere, make_context, table, from_above):
    context, _ = constrained(make_context(sphere, seed=7), planner, (from_above, table))
    search = make_search("dual", context)
    while context.evaluator.n_attempts < 500:
        search.step()
    found = context.archive.best(30)
    assert len(found) >= 5
    z = np.stack([c.T_object_palm[:3, 2] for c in found])
    assert (z @ -UP >= np.cos(np.deg2rad(40.0)) - 1e-9).all()


def test_a_hand_that_lacks_height_is_lifted_until_its_grasp_is_free(
    planner, sphere, make_context, table
):
    context, _ = constrained(make_context(sphere, seed=8), planner, (table,))
    search = make_search("random-adaption", context)
    while len(context.archive) < 10:
        search.step()
    good = context.archive.best(10, 0.05)
    T = np.stack([c.T_object_palm for c in good])
    spread = np.array([c.preshape for c in good])
    low = T.copy()
    low[:, :3, 3] -= 0.02 * UP
    plain = context.evaluator.attempt(low, spread)
    fitted = HandFitting(context).attempt(low, spread)
    moved = (fitted.T_object_palm - low)[:, :3, 3]
    np.testing.assert_array_equal(fitted.T_object_palm[:, :3, :3], low[:, :3, :3])
    np.testing.assert_allclose(moved, (moved @ UP)[:, None] * UP, atol=1e-12)
    assert ((moved @ UP >= -1e-12) & (moved @ UP < 0.24)).all()
    free = fitted.status == AttemptStatus.GRASPED
    assert free.sum() >= (plain.status == AttemptStatus.GRASPED).sum()


@pytest.mark.parametrize("name", ["dual", "random-adaption"])
def test_without_constraints_a_search_finds_the_same_to_the_bit(
    name, planner, sphere, make_context
):
    plain = make_context(sphere, seed=9)
    none, _ = constrained(make_context(sphere, seed=9), planner, ())
    for context in (plain, none):
        search = make_search(name, context)
        while context.evaluator.n_attempts < 400:
            search.step()
    assert plain.evaluator.n_attempts == none.evaluator.n_attempts
    assert len(plain.archive) == len(none.archive) > 0
    for a, b in zip(plain.archive.best(50, 0.01), none.archive.best(50, 0.01), strict=True):
        np.testing.assert_array_equal(a.T_object_palm, b.T_object_palm)
        assert (a.objective, a.epsilon) == (b.objective, b.epsilon)
        np.testing.assert_array_equal(a.preshape, b.preshape)


def test_the_way_to_where_hands_are_allowed_is_what_they_are_lifted(
    planner, sphere, make_context, table, rng
):
    context, _ = constrained(make_context(sphere, seed=10), planner, (table,))
    T = np.tile(np.eye(4), (20, 1, 1))
    T[:, :3, :3] = np.diag([1.0, -1.0, -1.0])  # from above
    T[:, 2, 3] = rng.uniform(0.05, 0.3, 20)
    joints = open_postures(planner.hand, np.zeros((20, 1)))
    way = HandFitting(context).way_to_allowed(T, joints)
    lifted = T.copy()
    lifted[:, 2, 3] += way
    np.testing.assert_array_equal(way == 0.0, table.allows(T, joints))
    assert table.allows(lifted, joints).all()
    assert (way > 0.0).any()
    assert (way == 0.0).any()
    np.testing.assert_array_equal(
        HandFitting(make_context(sphere)).way_to_allowed(T, joints), np.zeros(20)
    )


def test_a_posture_that_is_told_decides_how_far_a_hand_is_lifted(
    planner, sphere, make_context, table
):
    """Straight fingers reach deeper than curled ones: the same palm is lifted farther."""
    context, closed = constrained(make_context(sphere, seed=11), planner, (table,))
    T = np.eye(4)[None].copy()
    T[:, :3, :3] = np.diag([1.0, -1.0, -1.0])
    T[:, 2, 3] = 0.1
    heights = []
    for motor in (0.6, 2.2):
        joints = joints_from_motors(planner.hand, np.zeros((1, 1)), np.full((1, 3), motor))
        before = len(closed.T)
        HandFitting(context).attempt(T, np.zeros((1, 1)), joints)
        first = closed.T[before][0, 2, 3]
        assert first == pytest.approx(0.1 + HandFitting(context).way_to_allowed(T, joints)[0])
        heights.append(first)
    assert abs(heights[0] - heights[1]) > 0.01
