"""The whole planner on catalogue parts: repeatable, bounded, and honest about its answer."""

from __future__ import annotations

import itertools
from dataclasses import replace
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.grasp.funnel import Loss, Step
from gpis_grasp_planner.grasp.order import DISTINCT, pose_difference
from gpis_grasp_planner.grasp.trials import TrialOutcome, Trials
from gpis_grasp_planner.plan import hand_limits
from gpis_grasp_planner.plan import run as run_module
from gpis_grasp_planner.plan import search_evaluator as evaluator_module
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.progress import Monitor, Phase
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.search.searches import PLANNERS

LONG_S = 600.0
EVALUATIONS = 250


def figures(result):
    """Everything of the grasps that a caller sees, as one array per grasp."""
    return [
        np.concatenate(
            [
                g.T_object_palm.ravel(),
                g.joints,
                g.pregrasp_joints,
                g.contacts.positions.ravel(),
                [g.epsilon, g.volume],
            ]
        )
        for g in result.grasps
    ]


@pytest.fixture(scope="module")
def mug(catalogue):
    return catalogue.load("mug")


@pytest.fixture(scope="module")
def request_of_mug():
    return PlanRequest(
        seed=5,
        time_budget_s=LONG_S,
        max_evaluations=EVALUATIONS,
        n_grasps=8,
        friction=Friction(finger=0.5, palm=0.3),
    )


@pytest.fixture(scope="module")
def progress():
    return []


@pytest.fixture(scope="module")
def result(planner, mug, request_of_mug, progress):
    return planner.plan(mug, request_of_mug, on_progress=progress.append)


def test_the_answer_is_ranked_distinct_and_exact(result, mug, oracle):
    assert result.code is ErrorCode.SUCCESS
    assert result.success
    assert 3 <= len(result.grasps) <= 8
    objective = [g.epsilon + 0.5 * g.volume for g in result.grasps]
    assert objective == sorted(objective, reverse=True)
    radius = np.linalg.norm(mug.mesh.vertices - mug.center_of_mass, axis=1).max()
    assert result.torque_scale == pytest.approx(radius, rel=1e-15)
    for a, grasp in enumerate(result.grasps):
        epsilon, volume = oracle.hull_figures(grasp.contacts, mug.center_of_mass, radius, 8)
        assert grasp.epsilon == pytest.approx(epsilon, rel=1e-6)
        assert grasp.volume == pytest.approx(volume, rel=1e-6)
        for other in result.grasps[a + 1 :]:
            assert oracle.apart(grasp.T_object_palm, other.T_object_palm, radius) >= 0.2 - 1e-9
    assert result.message.startswith(f"{len(result.grasps)} grasps of 'mug'")
    assert result.best_attempt is None


def test_contacts_touch_the_mesh_with_the_requests_friction(result, mug, planner):
    triangles = mug.mesh.vertices[mug.mesh.faces]
    for grasp in result.grasps:
        c = grasp.contacts
        for p in c.positions:
            nearest = trimesh.triangles.closest_point(triangles, np.tile(p, (len(triangles), 1)))
            assert np.linalg.norm(nearest - p, axis=1).min() <= result.contact_threshold + 1e-9
        assert_allclose(np.linalg.norm(c.normals_inward, axis=1), 1.0, atol=1e-9)
        palm = np.array([planner.hand.link_friction_group[link] == "palm" for link in c.links])
        assert_allclose(c.friction, np.where(palm, 0.3, 0.5), atol=0.0)
        assert len(c) >= 2


def test_joints_are_within_limits_and_the_fingers_close_from_the_pregrasp(result, planner):
    hand = planner.hand
    for grasp in result.grasps:
        assert np.all(grasp.joints >= hand.joint_lower - 1e-9)
        assert np.all(grasp.joints <= hand.joint_upper + 1e-9)
        for finger in hand.fingers:
            inner = grasp.pregrasp_joints[finger.inner_joint]
            assert 0.0 <= inner <= grasp.joints[finger.inner_joint]
            coupled = finger.closing_ratio[0, 1] * inner
            assert grasp.pregrasp_joints[finger.distal_joint] == pytest.approx(coupled, abs=1e-9)
        assert_allclose(grasp.approach_direction, grasp.T_object_palm[:3, 2], atol=0.0)


def test_evaluations_are_counted_and_end_the_search(result):
    # The limit is looked at between steps; a step is a batch of proposals or of neighbours.
    settings = PlannerSettings()
    largest_step = max(settings.hpp.batch * settings.adaption.n_seed, settings.refinement.samples)
    assert EVALUATIONS <= result.evaluations < EVALUATIONS + largest_step


def test_the_funnel_leads_from_the_proposals_to_what_was_confirmed(result, planner):
    funnel = result.funnel
    left = [funnel.left(step) for step in funnel.steps]
    assert left == sorted(left, reverse=True)
    # In free space every attempt is one proposal, and so is each palm that found no free place.
    assert funnel.proposed - funnel.causes(Step.PALM_FREE).get(Loss.DEEP, 0) == result.evaluations
    assert funnel.last is Step.CONFIRMED
    assert funnel.left(Step.CONFIRMED) >= len(result.grasps) > 0
    assert f"confirmed {funnel.left(Step.CONFIRMED)} of" in " ".join(result.notes)
    assert not funnel.blocked
    assert not funnel.screened


def test_the_funnel_of_trials_ends_with_what_held(planner, sphere):
    request = PlanRequest(seed=4, max_evaluations=200, n_grasps=4, verification="rank")
    result = planner.plan(sphere, request)
    funnel = result.funnel
    held = [g for g in result.grasps if g.trials is not None and g.trials.held]
    assert funnel.left(Step.HELD) >= len(held) > 0
    tried, holds = funnel.left(Step.TRIED), funnel.left(Step.HELD)
    assert (
        f"Tried in physics: {tried} grasp{'s' * (tried != 1)}, of which {holds} held"
        in " ".join(result.notes)
    )


def test_convergence_rises_to_the_best_of_the_search(result):
    elapsed, evaluations, epsilon = np.array(result.convergence).T
    assert np.all(np.diff(elapsed) >= 0.0)
    assert np.all(np.diff(evaluations) > 0)
    assert np.all(np.diff(epsilon) > 0.0)
    assert evaluations[-1] <= result.evaluations
    # The search's epsilon is an upper bound of the exact one.
    assert epsilon[-1] >= max(g.epsilon for g in result.grasps) * (1.0 - 1e-9)


def test_progress_is_monotone(progress, result):
    assert progress
    for before, after in itertools.pairwise(progress):
        assert after.elapsed_s >= before.elapsed_s
        assert after.evaluations >= before.evaluations
        assert after.best_epsilon >= before.best_epsilon
    assert all(p.time_budget_s == LONG_S for p in progress)
    assert progress[0].evaluations == 0
    assert [p for p, _ in itertools.groupby(p.phase for p in progress)] == [
        Phase.PREPARING,
        Phase.SEARCHING,
        Phase.PLACING,
    ]
    assert progress[-1].evaluations <= result.evaluations


def test_the_result_says_what_was_asked_and_with_what(result, request_of_mug, mug, planner):
    assert result.request == request_of_mug
    assert result.friction == Friction(0.5, 0.3)
    assert result.mesh_id == "mug"
    assert result.mesh_hash == mug.mesh.content_hash
    assert result.settings == planner.settings.as_dict()
    assert result.joint_names == planner.hand.joint_names
    assert_allclose(result.center_of_mass, mug.center_of_mass, atol=0.0)


def test_the_same_seed_gives_the_same_grasps_on_a_fresh_planner(result, mug, request_of_mug):
    again = GraspPlanner().plan(mug, request_of_mug)
    assert again.evaluations == result.evaluations
    assert len(again.grasps) == len(result.grasps)
    for one, other in zip(figures(result), figures(again), strict=True):
        assert np.array_equal(one, other)


def test_another_seed_gives_other_grasps(result, planner, mug, request_of_mug):
    fields = {**vars(request_of_mug), "seed": 6}
    other = planner.plan(mug, PlanRequest(**fields))
    for one in figures(result):
        assert not any(np.array_equal(one, two) for two in figures(other))


@pytest.mark.parametrize("name", sorted({"dual", "hpp", "random", "random-adaption"}))
def test_every_search_is_repeatable(name, planner, sphere):
    def plan():
        request = PlanRequest(
            planner=name, seed=9, time_budget_s=LONG_S, max_evaluations=120, n_grasps=3
        )
        return planner.plan(sphere, request)

    one, two = plan(), plan()
    assert one.evaluations == two.evaluations >= 120
    assert len(one.grasps) == len(two.grasps)
    assert all(np.array_equal(a, b) for a, b in zip(figures(one), figures(two), strict=True))


def test_unknown_planner_is_refused_before_any_work(planner, sphere):
    with pytest.raises(RequestError) as error:
        planner.plan(sphere, PlanRequest(planner="best"), should_stop=pytest.fail)
    assert error.value.code is ErrorCode.UNKNOWN_PLANNER
    assert all(name in str(error.value) for name in PLANNERS)


@pytest.mark.parametrize("asked", [1, 2, 5])
def test_cancelling_ends_the_search_at_the_next_step(asked, planner, sphere):
    calls = iter(range(1, 1000))
    result = planner.plan(
        sphere,
        PlanRequest(planner="hpp", time_budget_s=LONG_S),
        should_stop=lambda: next(calls) >= asked,
    )
    assert next(calls) == asked + 1
    assert result.code is ErrorCode.CANCELLED
    assert result.message == "Planning for 'ball' was cancelled."
    settings = planner.settings
    assert result.evaluations <= (asked - 1) * settings.hpp.batch * settings.adaption.n_seed
    assert (result.evaluations == 0) == (asked == 1)


@pytest.fixture
def clock():
    """A clock that goes 10 ms forward whenever it is read."""
    clock = SimpleNamespace(now=1000.0)

    def read():
        clock.now += 0.01
        return clock.now

    clock.read = read
    return clock


def test_cancelling_leaves_a_moment_for_exact_figures(clock, planner, sphere):
    # 0.2 s are 20 readings of this clock; a hundred grasps would take more than a hundred.
    calls = iter(range(1000))
    monitor = Monitor(LONG_S, should_stop=lambda: next(calls) >= 8, clock=clock.read)
    request = PlanRequest(planner="hpp", time_budget_s=LONG_S, n_grasps=200)
    result = planner.answer(sphere, request, monitor=monitor).result
    assert result.code is ErrorCode.CANCELLED
    assert 1 <= len(result.grasps) <= 21


@pytest.mark.parametrize("budget", [0.3, 0.5, 2.0])
def test_the_search_ends_within_the_budget(budget, clock, planner, sphere):
    planner.prepare(sphere)
    start = clock.now
    asked = []
    monitor = Monitor(
        budget, should_stop=lambda: asked.append(clock.now) or False, clock=clock.read
    )
    request = PlanRequest(planner="random", time_budget_s=budget, n_grasps=1)
    planner.answer(sphere, request, monitor=monitor)
    # The last question is before the budget's end, and time for the finalist is left.
    assert asked[-1] - start < budget
    assert clock.now - start < budget + 0.1


class NeverFree:
    """An object at which no hand comes free: nothing is ever attempted."""

    n_attempts = n_states = 0

    def __init__(self, hand, part, friction, *_):
        self.friction = friction

    def clear_palm(self, T, normals, spread, standoff):
        return T, np.zeros(len(T), dtype=bool)

    def attempt(self, T, spread):
        assert len(T) == 0
        return self.empty

    postures = attempt_from = approach = guided_potential = attempt


class FirstOfferHolds:
    """Trials in which the first grasp that was offered holds and no other is tried."""

    n_tried = n_lost = 1
    offers: ClassVar[list] = []

    def __init__(self, *_):
        self.offers.clear()

    def offer(self, grasps):
        self.offers.extend(grasps)

    def poll(self, *_):
        pass

    begin = finish = poll

    def with_trials(self, grasp):
        first = np.array_equal(grasp.T_object_palm, self.offers[0].T_object_palm)
        return replace(grasp, trials=Trials((TrialOutcome("case", True),)) if first else None)

    @property
    def held(self):
        return [self.with_trials(self.offers[0])] if self.offers else []

    def close(self):
        pass


def test_what_held_beside_the_search_is_answered_first(clock, planner, sphere, monkeypatch):
    """However many better grasps the search found after it, which nobody tried."""
    planner.prepare(sphere)
    monkeypatch.setattr(run_module, "RunningTrials", FirstOfferHolds)
    request = PlanRequest(seed=3, time_budget_s=2.0, n_grasps=4, verification="rank")
    result = planner.answer(sphere, request, monitor=Monitor(2.0, clock=clock.read)).result
    assert result.code == ErrorCode.SUCCESS
    first, *others = result.grasps
    assert np.array_equal(first.T_object_palm, FirstOfferHolds.offers[0].T_object_palm)
    assert first.trials.held
    assert all(grasp.trials is None for grasp in others)
    apart = pose_difference(
        first.T_object_palm, np.stack([g.T_object_palm for g in others]), sphere.max_radius
    )
    assert apart.min() >= DISTINCT
    notes = " ".join(result.notes)
    assert "1 grasp, of which 1 held" in notes
    assert "1 trials were lost" in notes


@pytest.mark.parametrize("name", ["hpp", "dual", "paper", "random-adaption"])
def test_a_search_without_attempts_ends(name, clock, planner, sphere, oracle, monkeypatch):
    planner.prepare(sphere)
    NeverFree.empty = oracle.make_attempts(np.zeros((0, 4, 4)), [])
    monkeypatch.setattr(evaluator_module, "CompiledEvaluator", NeverFree)
    request = PlanRequest(planner=name, time_budget_s=0.2)
    result = planner.answer(sphere, request, monitor=Monitor(0.2, clock=clock.read)).result
    assert result.code is ErrorCode.NO_FEASIBLE_GRASP
    assert result.evaluations == 0
    assert result.best_attempt is None


def test_a_box_beyond_the_hand_is_refused_by_the_bound(planner, oracle, monkeypatch):
    monkeypatch.setattr(hand_limits, "_LONGEST_S", LONG_S)  # also on a busy machine
    box = oracle.make_part("crate", trimesh.creation.box([0.9, 0.9, 0.9]), Friction(0.3, 0.3))
    box = replace(box, mass=1.0)  # its size is what is refused
    result = planner.plan(box, PlanRequest(seed=1, time_budget_s=LONG_S))
    assert result.code is ErrorCode.NO_FEASIBLE_GRASP
    assert result.evaluations == 0
    assert "'crate' (900, 900, 900 mm) can have force closure with this hand" in result.message


def test_a_box_beyond_the_hand_has_no_grasp_and_says_so(planner, oracle, monkeypatch):
    # The search behind the bound agrees with it.
    monkeypatch.setattr(run_module, "limit_of", lambda *_: None)
    box = oracle.make_part("crate", trimesh.creation.box([0.9, 0.9, 0.9]), Friction(0.3, 0.3))
    result = planner.plan(box, PlanRequest(seed=1, time_budget_s=LONG_S, max_evaluations=150))
    assert result.code is ErrorCode.NO_FEASIBLE_GRASP
    assert not result.success
    assert result.grasps == ()
    assert "'crate' (900, 900, 900 mm)" in result.message
    assert f"in {result.evaluations} attempts" in result.message
    assert result.best_attempt is not None
    assert not result.best_attempt.feasible
    assert result.best_attempt.epsilon == -1.0
    assert len(result.best_attempt.contacts) >= 2


def test_mean_of_twenty_is_far_above_plain_random_sampling(planner, catalogue):
    # Three seeds, equal evaluations; a list that is not full counts zero for what is missing.
    def mean_of_twenty(part, name, seed):
        request = PlanRequest(
            planner=name, seed=seed, time_budget_s=LONG_S, max_evaluations=400, n_grasps=20
        )
        return sum(g.epsilon for g in planner.plan(part, request).grasps) / 20.0

    for mesh_id in ("bearing_cover", "mug"):
        part = catalogue.load(mesh_id)
        mean = {
            name: np.mean([mean_of_twenty(part, name, seed) for seed in range(3)])
            for name in ("hpp", "random")
        }
        print(mesh_id, "mean epsilon of 20, three seeds, 400 evaluations:", mean)
        assert mean["hpp"] > 5.0 * mean["random"]
        assert mean["hpp"] > 0.02
