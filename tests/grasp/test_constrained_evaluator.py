"""A search that knows the table: the plain evaluator's attempts, less the blocked ones."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.grasp.constrained_evaluator import ConstrainedEvaluator
from gpis_grasp_planner.grasp.constraint import ClosedHands, Constraint, Verdict
from gpis_grasp_planner.grasp.evaluator import AttemptStatus, PostureEvaluator
from gpis_grasp_planner.grasp.funnel import Step
from gpis_grasp_planner.grasp.open_hand import open_postures
from gpis_grasp_planner.quality.objective import EpsilonVolume
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.search.finalists import choose_finalists
from gpis_grasp_planner.search.searches import make_search
from gpis_grasp_planner.surroundings.clearance_settings import ClearanceSettings
from gpis_grasp_planner.surroundings.obstacles import SupportPlane
from gpis_grasp_planner.surroundings.support_constraint import SupportConstraint

RADIUS = 0.035
TABLE = SupportPlane(np.array([0.0, 0.0, -RADIUS]), np.array([0.0, 0.0, 1.0]))
SETTINGS = ClearanceSettings()


def plain_evaluator(planner, part):
    prepared = planner.prepare(part)
    return CompiledEvaluator(
        planner.hand, part, part.friction, planner.settings.scene, prepared.field, prepared.tree
    )


def evaluators(planner, part, table=TABLE):
    plain = plain_evaluator(planner, part)
    retreat = planner.settings.scene.retreat_m
    table = SupportConstraint(planner.hand, table, SETTINGS.margin_m, retreat)
    return plain, ConstrainedEvaluator(plain, planner.hand, (table,), retreat)


@pytest.fixture(scope="module")
def ball_grasps(planner, sphere, make_context):
    """Poses and spreads of grasps of the ball in free space, all round it."""
    context = make_context(sphere, seed=3, evaluator=plain_evaluator(planner, sphere))
    search = make_search("random-adaption", context)
    while len(context.archive) < 40:
        search.step()
    candidates = context.archive.best(60, 0.05)
    return np.stack([c.T_object_palm for c in candidates]), np.array(
        [c.preshape for c in candidates]
    )


def test_attempts_are_the_plain_ones_less_the_blocked(planner, sphere, ball_grasps):
    plain, table = evaluators(planner, sphere)
    assert isinstance(table, PostureEvaluator)
    T, spread = ball_grasps
    joints = open_postures(planner.hand, spread)
    before, after = plain.attempt_from(T, joints), table.attempt_from(T, joints)
    blocked = after.status == AttemptStatus.BLOCKED
    lost = table.tally.funnel(Step.CLEAR)
    assert 0 < lost.screened["support"] < blocked.sum() < len(T)
    assert sum(lost.blocked.values()) + sum(lost.screened.values()) == blocked.sum()
    assert lost.proposed == len(T)
    kept = (after.status == AttemptStatus.GRASPED) & (after.epsilon > 0.0)
    assert lost.left(Step.CLEAR) == kept.sum() > 0
    assert table.n_attempts == len(T) + len(T)  # those of the plain one's own call come first
    for field in fields(before):
        values = getattr(before, field.name)
        if values is not None:
            np.testing.assert_array_equal(
                values[~blocked], getattr(after, field.name)[~blocked], err_msg=field.name
            )
    assert (before.epsilon[blocked] > 0.0).all()
    assert (after.objective(EpsilonVolume(0.1))[blocked] == 0.0).all()
    np.testing.assert_array_equal(after.T_object_palm, T)
    np.testing.assert_allclose(after.preshape, spread, atol=1e-12)


def test_a_narrow_start_ends_in_the_same_grasp(planner, sphere, ball_grasps):
    """What is free only from a narrow start is the grasp that open fingers would have made."""
    # The ball is held up so far that closed fingers reach round it, and open ones the table.
    low = SupportPlane(np.array([0.0, 0.0, -2.0 * RADIUS]), np.array([0.0, 0.0, 1.0]))
    plain, table = evaluators(planner, sphere, low)
    T, spread = ball_grasps
    opened = open_postures(planner.hand, spread)
    wide, free = table.attempt_from(T, opened), table.attempt(T, spread)
    good = free.status == AttemptStatus.GRASPED
    narrow = good & (wide.status == AttemptStatus.BLOCKED)
    assert narrow.sum() >= 3
    assert not ((wide.status == AttemptStatus.GRASPED) & ~good).any()
    np.testing.assert_array_equal(free.start_joints[good & ~narrow], opened[good & ~narrow])
    assert (free.start_joints[narrow] >= opened[narrow]).all()
    np.testing.assert_allclose(
        free.joints[narrow], plain.attempt(T, spread).joints[narrow], atol=0.01
    )
    [support] = table.constraints
    assert not support.verdict(hands_of(planner, free, good)).blocked.any()


def test_the_verdicts_shift_frees_the_same_motion(planner, sphere, ball_grasps):
    """Without a part in the way, a hand that is moved by its shift is blocked no more."""
    _, table = evaluators(planner, sphere)
    T, spread = ball_grasps
    attempts = table.attempt_from(T, open_postures(planner.hand, spread))
    moved = attempts.shift.any(axis=1)
    assert moved.sum() > 3
    assert (attempts.status[moved] == AttemptStatus.BLOCKED).all()
    [support] = table.constraints
    closed = hands_of(planner, attempts, moved)
    assert support.verdict(closed).blocked.all()
    lifted = hands_of(planner, attempts, moved, attempts.shift[moved])
    assert not support.verdict(lifted).blocked.any()
    shift = attempts.shift[moved]
    short = shift * (1.0 - 2e-6 / np.linalg.norm(shift, axis=1, keepdims=True))
    lifted = hands_of(planner, attempts, moved, short)
    assert support.verdict(lifted).blocked.all()


def hands_of(planner, attempts, rows, shift=0.0):

    hands = ClosedHands.of(
        planner.hand, attempts, np.flatnonzero(rows), planner.settings.scene.retreat_m
    )
    hands.T_object_palm[:, :3, 3] += shift
    return hands


def test_without_constraints_it_is_the_plain_evaluator_to_the_bit(planner, sphere, ball_grasps):
    plain = plain_evaluator(planner, sphere)
    none = ConstrainedEvaluator(plain, planner.hand, (), planner.settings.scene.retreat_m)
    T, spread = ball_grasps
    joints = open_postures(planner.hand, spread)
    for before, after in (
        (plain.attempt(T, spread), none.attempt(T, spread)),
        (plain.attempt_from(T, joints), none.attempt_from(T, joints)),
    ):
        for field in fields(before):
            np.testing.assert_array_equal(getattr(before, field.name), getattr(after, field.name))
    assert none.n_attempts == plain.n_attempts == 4 * len(T)


class Recorded(Constraint):
    """Allows and blocks by the palm's x; remembers how many hands it was asked for."""

    def __init__(self, name, allows_below=np.inf, blocks_above=np.inf):
        self._name, self._allows, self._blocks = name, allows_below, blocks_above
        self.asked, self.judged = [], []

    @property
    def name(self):
        return self._name

    def allows(self, T_object_palm, _joints, /):
        self.asked.append(len(T_object_palm))
        return T_object_palm[:, 0, 3] < self._allows

    allows_palm = allows

    def verdict(self, closed):
        self.judged.append(len(closed))
        verdict = Verdict.clear(len(closed))
        verdict.cause[closed.T_object_palm[:, 0, 3] > self._blocks] = self._name
        return verdict


def test_constraints_are_asked_in_sequence_and_the_first_to_object_counts(
    planner, sphere, ball_grasps
):
    T, spread = ball_grasps
    x = np.sort(T[:, 0, 3])
    n = len(T)
    one = Recorded("one", allows_below=x[n - 5])
    two = Recorded("two", allows_below=x[n - 9], blocks_above=x[n - 20])
    three = Recorded("three", allows_below=x[n - 3], blocks_above=x[n - 25])
    plain = plain_evaluator(planner, sphere)
    evaluator = ConstrainedEvaluator(
        plain, planner.hand, (one, two, three), planner.settings.scene.retreat_m
    )
    attempts = evaluator.attempt_from(T, open_postures(planner.hand, spread))
    assert [c.asked for c in (one, two, three)] == [[n], [n - 5], [n - 9]]
    assert evaluator.tally.funnel(Step.CLEAR).screened == {"one": 5, "two": 4}
    closed = plain.n_attempts
    assert closed == n - 9
    assert (one.judged, two.judged) == ([closed], [closed])
    assert evaluator.tally.funnel(Step.CLEAR).blocked == {"two": 10, "three": 5}
    assert three.judged == [closed - 10]
    assert (attempts.status == AttemptStatus.BLOCKED).sum() == 9 + 15


def test_a_state_that_is_forbidden_has_no_finite_energy(planner, sphere, rng):
    plain, table = evaluators(planner, sphere)
    T = transform(Rotation.random(60, rng=rng).as_matrix(), rng.uniform(-0.25, 0.25, (60, 3)))
    joints = open_postures(planner.hand, rng.uniform(0.0, np.pi, (60, 1)))
    [support] = table.constraints
    allowed = support.allows(T, joints)
    energy = table.guided_potential(T, joints)
    assert 0 < allowed.sum() < 60
    assert np.isinf(energy[~allowed]).all()
    np.testing.assert_array_equal(energy[allowed], plain.guided_potential(T, joints)[allowed])


def test_a_search_on_it_answers_with_clear_grasps_only(planner, sphere, make_context, referee):
    _, table = evaluators(planner, sphere)
    context = make_context(sphere, seed=4, evaluator=table)
    search = make_search("hpp", context)
    while table.n_attempts < 500:
        search.step()
    grasps = choose_finalists(context, 10, None)
    assert len(grasps) >= 5
    assert table.tally.funnel(Step.CLEAR).blocked
    for grasp in grasps:
        for poses in referee.way(grasp, n_back=5, n_closing=15):
            lowest = min(
                (poses[link][:3, :3] @ np.array(piece.vertices).T)[2].min() + poses[link][2, 3]
                for link, pieces in enumerate(planner.hand.link_collision)
                for piece in pieces
            )
            assert lowest >= -RADIUS + SETTINGS.margin_m - 1e-9
