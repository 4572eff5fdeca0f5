"""Alg. 3 on a ball, where every distance, normal and hull is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gpis_grasp_planner.grasp.evaluator import AttemptStatus
from gpis_grasp_planner.hand.drive import motors_from_joints
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.search.admm_cp_opt import ContactPointOptimiser
from gpis_grasp_planner.search.settings import AdmmCpSettings

RADIUS = 0.035
UPPER = np.deg2rad([180.0, 140.0, 140.0, 140.0])
FINGERTIP_GRASP_M = RADIUS + 0.0793 + 0.06


def palm_above():
    """Palm over the ball looking down, far enough for the fingertips."""
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[2, 3] = FINGERTIP_GRASP_M
    return T


@pytest.fixture
def make_optimiser(make_context, sphere):
    def make(volume_weight=0.0, seed=0, **admm):
        settings = PlannerSettings.from_mapping(
            {"hpp": {"volume_weight": volume_weight}, "admm": admm}
        )
        context = make_context(sphere, seed=seed, settings=settings)
        return ContactPointOptimiser(context), context

    return make


@pytest.fixture
def hand_made(make_optimiser, planner):
    """A three-finger grasp with fingertips about the equator: (joints, scaled motors)."""
    _, context = make_optimiser()
    grasp = context.evaluator.attempt(palm_above()[None], np.array([[np.pi / 3]]))
    assert grasp.status[0] == AttemptStatus.GRASPED
    [spread], [fingers] = motors_from_joints(planner.hand, grasp.joints[0])
    return grasp, np.concatenate([spread, fingers]) / UPPER


@pytest.fixture
def poor(make_optimiser):
    """Joints of a grasp at the same palm that a smaller spread would improve."""
    _, context = make_optimiser()
    grasp = context.evaluator.attempt(palm_above()[None], np.array([[np.pi / 2]]))
    assert 0.0 < grasp.epsilon[0] < 0.2
    return grasp.joints[0]


def spherical_contacts(points, reach):
    """Contacts of a ball at the points within reach of its surface, by the ball's own formula."""
    distance = np.linalg.norm(points, axis=1)
    points = points[np.abs(distance - RADIUS) <= reach]
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    return Contacts(
        RADIUS * normals, -normals, np.full(len(points), 0.6), np.zeros(len(points), dtype=np.intp)
    )


def test_motors_of_a_closed_hand_give_that_hand(make_optimiser, hand_made):
    _, context = make_optimiser()
    grasp, x = hand_made
    postures = context.evaluator.postures(palm_above()[None], (x * UPPER)[None])
    assert_allclose(postures.joints[0], grasp.joints[0], atol=2e-3)
    distance = np.linalg.norm(postures.points[0, :, 0], axis=1) - RADIUS
    assert_allclose(distance, 0.0, atol=5e-4)


def test_objective_of_a_hand_made_grasp_is_the_hulls(make_optimiser, hand_made, oracle):
    optimiser, context = make_optimiser()
    _, x = hand_made
    points = context.evaluator.postures(palm_above()[None], (x * UPPER)[None]).points[0, :, 0]
    contacts = spherical_contacts(points, 1.0)
    assert len(contacts) == 3
    epsilon, _ = oracle.hull_figures(contacts, np.zeros(3), context.max_radius, 8)
    assert epsilon > 0.05
    value = optimiser.quality(palm_above(), x[None])[0]
    assert value == pytest.approx(epsilon, rel=0.05)
    weighted, _ = make_optimiser(volume_weight=0.5)
    assert weighted.quality(palm_above(), x[None])[0] > value


def test_fingers_out_of_reach_are_no_contacts(make_optimiser, hand_made, oracle):
    optimiser, context = make_optimiser(contact_reach_mm=8.0)
    _, x = hand_made
    rng = np.random.default_rng(7)
    # Each finger a little before the surface, or far from it.
    back = np.where(rng.random((40, 3)) < 0.6, rng.uniform(-0.012, 0.0, (40, 3)), -0.25)
    X = np.clip(x + np.column_stack([np.zeros(40), back]), 0.0, 1.0)
    values = optimiser.quality(palm_above(), X)
    postures = context.evaluator.postures(np.tile(palm_above(), (40, 1, 1)), X * UPPER)
    seen = set()
    for value, points, inner in zip(values, postures.points, postures.inner_touches, strict=True):
        links = np.concatenate([points[:, 0], points[:, 1:][inner]])
        distance = np.abs(np.linalg.norm(links, axis=1) - RADIUS)
        if np.any(np.abs(distance - 0.008) < 1e-3):
            continue  # within the fit's accuracy of the reach
        contacts = spherical_contacts(links, 0.008)
        seen.add(len(contacts))
        if len(contacts) < 3:
            # Two points with friction cannot hold a torque about the line through them.
            assert value == pytest.approx(0.0, abs=5e-3)
        else:
            epsilon, _ = oracle.hull_figures(contacts, np.zeros(3), context.max_radius, 8)
            assert value == pytest.approx(max(epsilon, 0.0), rel=0.1, abs=5e-3)
    assert {1, 2, 3} <= seen


def test_open_fingers_have_no_quality(make_optimiser):
    optimiser, _ = make_optimiser()
    assert optimiser.quality(palm_above(), np.zeros((1, 4))).tolist() == [0.0]


def test_penalty_is_the_square_of_the_excess_over_the_threshold(make_optimiser, hand_made):
    optimiser, context = make_optimiser(penalty_per_mm2=0.07)
    _, x = hand_made
    rng = np.random.default_rng(3)
    X = np.clip(x + rng.uniform(-0.2, 0.05, (60, 4)) * [0, 1, 1, 1], 0.0, 1.0)
    postures = context.evaluator.postures(np.tile(palm_above(), (60, 1, 1)), X * UPPER)
    surface, threshold = context.atlas.surface, context.settings.scene.contact_threshold_m
    violations = optimiser.violations(palm_above(), X)
    penalty = optimiser.penalty(palm_above(), X)
    for b in range(60):
        excess = [
            max(abs(surface.value(p[None])[0]) - threshold, 0.0) for p in postures.points[b, :, 0]
        ]
        assert_allclose(violations[b], excess, atol=1e-12)
        assert penalty[b] == pytest.approx(0.07 * sum((1e3 * e) ** 2 for e in excess), rel=1e-9)
    # The implicit surface is a distance near the ball.
    inside = np.linalg.norm(postures.points[:, :, 0], axis=2) - RADIUS
    expected = np.maximum(np.abs(inside) - threshold, 0.0)
    near = np.abs(inside) < 0.01
    assert_allclose(violations[near], expected[near], atol=4e-4)


class Shell:
    """An implicit surface that answers with prepared values."""

    def __init__(self, values):
        self.values = np.asarray(values)

    def value(self, points):
        return np.resize(self.values, len(points))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_points_within_the_threshold_are_no_violation(sign, make_optimiser, monkeypatch):
    optimiser, context = make_optimiser(penalty_per_mm2=0.05)
    threshold = context.settings.scene.contact_threshold_m
    for share, excess in [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (2.0, 1.0), (6.0, 5.0)]:
        monkeypatch.setattr(context.atlas, "surface", Shell([sign * share * threshold]))
        violations = optimiser.violations(palm_above(), np.full((1, 4), 0.3))
        assert_allclose(violations, excess * threshold, atol=1e-15)
        expected = 0.05 * 3 * (1e3 * excess * threshold) ** 2
        assert optimiser.penalty(palm_above(), np.full((1, 4), 0.3))[0] == pytest.approx(expected)


@pytest.fixture(scope="module")
def results(make_context, sphere):
    """Two seeds of the default ADMM from the hand-made grasp: (results, context, optimiser)."""
    context = make_context(sphere, seed=2)
    optimiser = ContactPointOptimiser(context)
    start = context.evaluator.attempt(palm_above()[None], np.array([[np.pi / 2]]))
    return optimiser.optimise(palm_above(), start.joints[0]), context, optimiser


def test_residuals_and_status_are_those_of_the_iterates(results):
    found, context, _ = results
    s = context.settings.admm
    assert len(found) == s.n_seed
    for result in found:
        admm = result.admm
        before = admm.z_start
        for k in range(admm.iterations):
            primal = np.linalg.norm(admm.q_history[k] - admm.z_history[k])
            dual = s.rho * np.linalg.norm(admm.z_history[k] - before)
            before = admm.z_history[k]
            assert admm.primal_residuals[k] == pytest.approx(primal, abs=1e-15)
            assert admm.dual_residuals[k] == pytest.approx(dual, abs=1e-14)
        met = primal <= s.primal_tolerance and dual <= s.dual_tolerance
        assert result.converged == met
        assert met or admm.iterations == s.max_iterations
        assert np.all((admm.z_history >= 0.0) & (admm.z_history <= 1.0))
        assert np.all((admm.q_history >= 0.0) & (admm.q_history <= 1.0))


def test_the_answer_is_the_consensus_in_radians(results):
    found, _, optimiser = results
    for result in found:
        assert_allclose(result.motors, result.admm.z * UPPER, atol=1e-12)
        worst = optimiser.violations(result.T_object_palm, result.admm.z[None]).max()
        assert result.violation_m == worst
        assert result.realised.preshape.tolist() == [[result.motors[0]]]
        assert_allclose(result.realised.T_object_palm[0], result.T_object_palm, atol=0.0)


def test_the_first_palm_stays_and_the_others_shift_on_a_chart(results):
    found, _, _ = results
    assert_allclose(found[0].T_object_palm, palm_above(), atol=0.0)
    for result in found[1:]:
        T = result.T_object_palm
        assert_allclose(T[:3, :3], palm_above()[:3, :3], atol=0.0)
        shift = T[:3, 3] - palm_above()[:3, 3]
        # The nearest chart is that of the ball's top: level, up to the spacing of its samples.
        assert 0.0 < np.linalg.norm(shift) <= np.sqrt(2.0) * 0.05 * RADIUS + 1e-12
        assert abs(shift[2]) < 0.3 * np.linalg.norm(shift)


def test_what_enters_the_archive_is_the_realised_grasp_without_penetration(
    results, planner, sphere, oracle
):
    found, context, _ = results
    grasped = [r for r in found if r.realised.status[0] == AttemptStatus.GRASPED]
    assert grasped
    assert len(context.archive) == sum(r.realised.epsilon[0] > 0.0 for r in grasped)
    for result in grasped:
        realised = result.realised
        links = oracle.posed_links(planner.hand, realised.T_object_palm[0], realised.joints[0])
        for pieces in links:
            for piece in pieces:
                assert not oracle.convex_overlap(piece, sphere.mesh.vertices)
        # Contacts of the real hand lie on the ball, which is a little inside its sphere.
        k = realised.n_contacts[0]
        distance = np.linalg.norm(realised.positions[0, :k], axis=1)
        threshold = context.settings.scene.contact_threshold_m
        assert np.all(distance <= RADIUS + threshold)
        assert np.all(distance >= RADIUS * 0.99)


def test_an_easy_case_converges(make_optimiser, hand_made):
    # A stiff consensus from a start that already touches.
    optimiser, _ = make_optimiser(rho=100.0, dual_tolerance=1.0, n_seed=1, max_iterations=30)
    grasp, _ = hand_made
    [result] = optimiser.optimise(palm_above(), grasp.joints[0])
    assert result.converged
    assert result.admm.primal_residuals[-1] <= AdmmCpSettings().primal_tolerance
    assert result.admm.dual_residuals[-1] <= 1.0
    assert result.admm.iterations < 30


def test_a_poor_spread_gets_better(make_optimiser, poor):
    # The grasp realised from each seed's answer, against the one it started from.
    start = poor[0] / UPPER[0]
    better = 0
    for seed in range(3):
        optimiser, context = make_optimiser(volume_weight=0.5, seed=seed)
        first = context.evaluator.attempt(palm_above()[None], poor[None, :1]).epsilon[0]
        found = optimiser.optimise(palm_above(), poor)
        better += max(r.realised.epsilon[0] for r in found) > 1.1 * first
        for result in found:
            assert np.all(np.abs(result.admm.q_history[:, 0] - start) <= 0.2 + 1e-12)
            assert np.all(np.abs(result.admm.z_history[:, 0] - start) <= 0.2 + 1e-12)
    assert better >= 2


def test_not_converging_is_a_status(make_optimiser, poor):
    optimiser, _ = make_optimiser(
        primal_tolerance=0.0, dual_tolerance=0.0, max_iterations=2, n_seed=1
    )
    [result] = optimiser.optimise(palm_above(), poor)
    assert not result.converged
    assert result.admm.iterations == 2
    assert result.realised.status[0] == AttemptStatus.GRASPED


def test_stopped_before_the_first_iteration_there_is_no_result(make_optimiser, poor):
    optimiser, context = make_optimiser()
    before = context.evaluator.n_attempts
    assert optimiser.optimise(palm_above(), poor, should_stop=lambda: True) == []
    assert context.evaluator.n_attempts == before


def test_stopped_later_the_result_is_what_there_is(make_optimiser, poor):
    optimiser, _ = make_optimiser(primal_tolerance=0.0, n_seed=2)
    asked = iter([False, False, True, True, True])
    [result] = optimiser.optimise(palm_above(), poor, lambda: next(asked))
    assert result.admm.iterations == 2
    assert not result.converged


def test_the_same_seed_gives_the_same_iterates(make_optimiser, poor):
    def histories(seed):
        optimiser, _ = make_optimiser(seed=seed, n_seed=2, max_iterations=2)
        found = optimiser.optimise(palm_above(), poor)
        return [(r.T_object_palm, r.admm.q_history, r.admm.z_history) for r in found]

    first, again, other = histories(5), histories(5), histories(6)
    for one, two in zip(first, again, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))
    assert not np.array_equal(first[1][0], other[1][0])
