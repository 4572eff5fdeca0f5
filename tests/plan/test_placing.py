"""An earlier plan at a place: who comes first under uncertainty, and when it is not enough."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from gpis_grasp_planner.errors import ErrorCode, PoseError, RequestError
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.geometry.transforms import from_position_quat_xyzw
from gpis_grasp_planner.grasp.funnel import Step
from gpis_grasp_planner.grasp.order import answer_rank
from gpis_grasp_planner.grasp.trials import TrialOutcome, Trials
from gpis_grasp_planner.hand.settings import HandSettings
from gpis_grasp_planner.plan import hold_ranking
from gpis_grasp_planner.plan.objective import make_objective
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.progress import Monitor
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.surroundings.clearance import clear_grasps
from gpis_grasp_planner.surroundings.covariance import covariance_in_object
from gpis_grasp_planner.surroundings.hold_probability import rank_under_uncertainty
from gpis_grasp_planner.surroundings.obstacles import BoxObstacle, SupportPlane, Surroundings
from gpis_grasp_planner.surroundings.place import Place
from gpis_grasp_planner.surroundings.uncertainty_settings import UncertaintySettings

NOISE = np.diag([0.005**2] * 3 + [np.deg2rad(5.0) ** 2] * 3)
SETTINGS = PlannerSettings(uncertainty=UncertaintySettings(samples=16))
REQUEST = PlanRequest(planner="hpp", seed=2, max_evaluations=320, time_budget_s=120.0, n_grasps=8)
ROCK = Surroundings(None, (BoxObstacle(np.eye(4), np.full(3, 2.0), "rock"),))


@pytest.fixture(scope="module")
def mug():
    return MeshCatalogue([default_catalogue_directory()]).load("mug")


@pytest.fixture(scope="module")
def planner():
    return GraspPlanner(SETTINGS)


@pytest.fixture(scope="module")
def plan(planner, mug):
    result = planner.plan(mug, REQUEST)
    assert len(result.grasps) >= 4
    return result


@pytest.fixture(scope="module")
def table(mug):
    """A place where the mug stands turned and moved on a table."""
    T = from_position_quat_xyzw([0.3, -0.2, 0.8], [0.0, 0.0, 0.6, 0.8])
    plane = SupportPlane(np.array([0.0, 0.0, 0.8 + mug.mesh.bounds[0][2]]), np.array([0.0, 0, 1]))
    return Place(T, Surroundings(plane))


def place_result(planner, part, result, place, n_grasps=None, monitor=None, **request):
    """The answer for a place from a plan alone."""
    n = result.request.n_grasps if n_grasps is None else n_grasps
    wanted = replace(result.request, n_grasps=n, **request)
    return planner.known_answer(part, result, wanted, place, monitor).answer


def test_a_place_with_nothing_changes_nothing(planner, mug, plan):
    assert not Place()
    answer = place_result(planner, mug, plan, Place())
    assert answer.result.grasps == plan.grasps
    assert answer.lift_direction is None
    assert place_result(planner, mug, plan, Place(), n_grasps=2).result.grasps == plan.grasps[:2]
    left_over = place_result(planner, mug, plan, Place(), n_grasps=2).result.reserve.estimates
    assert left_over[: len(plan.grasps) - 2] == plan.grasps[2:]


def test_hold_probabilities_are_those_of_the_ranking_and_decide_the_order(planner, mug, plan):
    answer = place_result(planner, mug, plan, Place(covariance=NOISE))
    prepared = planner.prepare(mug)
    evaluator = CompiledEvaluator(
        planner.hand, mug, plan.friction, SETTINGS.scene, prepared.field, prepared.tree
    )
    _, estimates = rank_under_uncertainty(
        evaluator, planner.hand, plan.grasps, NOISE, SETTINGS.uncertainty,
        np.random.default_rng(REQUEST.seed),
    )  # fmt: skip
    expected = {
        g.T_object_palm.tobytes(): e.probability
        for g, e in zip(plan.grasps, estimates, strict=True)
    }
    found = {g.T_object_palm.tobytes(): g.hold_probability for g in answer.result.grasps}
    assert found == expected
    in_order = [g.hold_probability for g in answer.result.grasps]
    assert in_order == sorted(in_order, reverse=True)
    assert len(set(in_order)) > 1
    # few are the best of all that were looked at, not of the first
    few = place_result(planner, mug, plan, Place(covariance=NOISE), n_grasps=2).result
    assert [g.hold_probability for g in few.grasps] == in_order[:2]
    assert few.message.startswith("2 grasps of 'mug', best first, ranked by")


def test_what_held_in_physics_stays_first(planner, mug, plan):
    worst = place_result(planner, mug, plan, Place(covariance=NOISE)).result.grasps[-1]
    held = Trials((TrialOutcome("strict", True),))
    tried = [
        replace(g, trials=held) if g.T_object_palm is worst.T_object_palm else g
        for g in plan.grasps
    ]
    answer = place_result(planner, mug, replace(plan, grasps=tuple(tried)), Place(covariance=NOISE))
    assert answer.result.grasps[0].T_object_palm is worst.T_object_palm
    ranks = [answer_rank(g, make_objective(SETTINGS)) for g in answer.result.grasps]
    assert ranks == sorted(ranks)


def test_covariances_can_be_left_alone(mug, plan):
    off = GraspPlanner(PlannerSettings(uncertainty=UncertaintySettings(method="none")))
    answer = place_result(off, mug, plan, Place(covariance=NOISE))
    assert answer.result.grasps == plan.grasps


def test_what_another_covariance_said_is_forgotten(planner, mug, plan):
    """Where no covariance is known, none of an earlier plan's decides, nor is answered."""
    stale = np.linspace(0.1, 1.0, len(plan.grasps))  # the worst has the best
    grasps = tuple(replace(g, hold_probability=p) for g, p in zip(plan.grasps, stale, strict=True))
    earlier = replace(plan, grasps=grasps, place=Place(covariance=NOISE).as_mapping())
    result = place_result(planner, mug, earlier, Place()).result
    assert [g.hold_probability for g in result.grasps] == [None] * len(plan.grasps)
    before = [g.T_object_palm.tobytes() for g in plan.grasps]
    assert [g.T_object_palm.tobytes() for g in result.grasps] == before


def test_known_grasps_compete_without_the_probability_that_new_ones_lack_yet(planner, mug, plan):
    known = planner.known_answer(mug, plan, plan.request, Place(covariance=NOISE))
    assert all(g.hold_probability is not None for g in known.answer.result.grasps)
    assert known.finished
    assert all(f.grasp.hold_probability is None for f in known.finished)


def test_nearly_the_same_covariance_costs_no_second_ranking(mug, plan, monkeypatch):
    planner = GraspPlanner(SETTINGS)
    first = place_result(planner, mug, plan, Place(covariance=NOISE)).result
    asked = []
    ranking = hold_ranking.rank_under_uncertainty
    monkeypatch.setattr(
        hold_ranking,
        "rank_under_uncertainty",
        lambda *arguments: asked.append(arguments[3]) or ranking(*arguments),
    )
    # the next estimate of a part that was moved: the covariance is the part's, and so the same
    moved = Place(from_position_quat_xyzw([1.0, 2.0, 0.5], [0, 0, 0, 1]), covariance=1.02 * NOISE)
    again = place_result(planner, mug, plan, moved).result
    assert [g.hold_probability for g in again.grasps] == [g.hold_probability for g in first.grasps]
    assert not asked
    # kept ones are known after the deadline, too
    late = Monitor(1.0, clock=iter(itertools.count(step=10.0)).__next__)
    result = place_result(planner, mug, plan, Place(covariance=NOISE), monitor=late).result
    assert [g.hold_probability for g in result.grasps] == [first.grasps[0].hold_probability]
    # another covariance, seed or friction is another question
    place_result(planner, mug, plan, Place(covariance=2.0 * NOISE))
    assert len(asked) == len(plan.grasps)
    place_result(planner, mug, plan, Place(covariance=2.0 * NOISE), seed=7)
    assert len(asked) == 2 * len(plan.grasps)


def test_a_bad_covariance_is_refused(planner, mug, plan):
    with pytest.raises(PoseError) as caught:
        place_result(planner, mug, plan, Place(covariance=-NOISE))
    assert caught.value.code == ErrorCode.INVALID_COVARIANCE


def test_after_the_deadline_one_grasp_is_still_estimated(planner, mug, plan):
    late = Monitor(1.0, clock=iter(itertools.count(step=10.0)).__next__)
    answer = place_result(planner, mug, plan, Place(covariance=NOISE), monitor=late)
    known = [g for g in answer.result.grasps if g.hold_probability is not None]
    assert len(known) == 1
    assert answer.result.notes == plan.notes  # the one that was chosen is all there is
    assert len(answer.result.grasps) == 1


def test_answers_on_a_table_are_clear_and_have_both(planner, mug, plan, table):
    C = covariance_in_object(NOISE, table.T_world_object[:3, :3])
    answer = place_result(planner, mug, plan, replace(table, covariance=C))
    grasps = answer.result.grasps
    assert grasps
    found = clear_grasps(planner.hand, grasps, table.around(), SETTINGS.clearance)
    assert all(clearance.clear for clearance in found)
    assert [c.distance_m for c in found] == pytest.approx(
        [c.distance_m for c in answer.clearances], abs=1e-9
    )
    for grasp in grasps:
        assert 0.0 <= grasp.hold_probability <= 1.0
        assert grasp.way_out == pytest.approx([0.0, 0.0, 1.0])
    assert Place.from_mapping(answer.result.place).around().support.point == pytest.approx(
        table.around().support.point
    )


def test_only_verified_grasps_where_those_are_required(planner, mug, plan, table):
    """No grasp of the reserve, which nobody tried, may slip into such an answer."""
    own = {g.T_object_palm.tobytes() for g in plan.grasps}
    for grasp in place_result(planner, mug, plan, table, verification="require").result.grasps:
        assert grasp.T_object_palm.tobytes() in own
    loose = place_result(planner, mug, plan, table).result.grasps
    assert {g.T_object_palm.tobytes() for g in loose} - own


def test_a_grasp_that_is_in_the_reserve_as_well_is_answered_once(planner, mug, plan, table):
    first = replace(plan.reserve.estimates[0], trials=Trials((TrialOutcome("strict", True),)))
    doubled = replace(plan, grasps=(first, *plan.grasps))
    grasps = place_result(planner, mug, doubled, table, n_grasps=100).result.grasps
    poses = [g.T_object_palm.tobytes() for g in grasps]
    assert len(set(poses)) == len(poses)


def test_where_all_kept_are_blocked_a_search_finds_what_there_is(planner, mug, plan, table):
    """The plan is made poor: of its grasps only those are kept that come through the table."""
    found = clear_grasps(planner.hand, plan.grasps, table.around(), SETTINGS.clearance)
    bad = tuple(g for g, c in zip(plan.grasps, found, strict=True) if not c.clear)
    assert bad
    poor = replace(plan, grasps=bad, reserve=replace(plan.reserve, estimates=()))
    first = place_result(planner, mug, poor, table)
    assert first.result.code == ErrorCode.ALL_GRASPS_BLOCKED
    answer = planner.answer(mug, REQUEST, table, known=poor)
    assert answer.result.code == ErrorCode.SUCCESS
    assert answer.result.evaluations >= REQUEST.max_evaluations
    again = clear_grasps(planner.hand, answer.result.grasps, table.around(), SETTINGS.clearance)
    assert all(c.clear for c in again)


def test_a_plan_for_this_very_place_needs_no_search(planner, mug, table):
    first = planner.answer(mug, REQUEST, table).result
    assert first.grasps
    again = planner.answer(mug, REQUEST, table, known=first).result
    assert [g.T_object_palm.tobytes() for g in again.grasps] == [
        g.T_object_palm.tobytes() for g in first.grasps
    ]
    assert "searching" not in again.phase_s
    # Its funnel is its own: of the plan's grasps, not of the search that found them.
    assert again.funnel.last is Step.CLEAR
    assert again.funnel.proposed == len(first.grasps)
    # the table a hand's breadth lower is another place: what is known competes with a search
    lower = SupportPlane(table.surroundings.support.point - [0, 0, 0.1], np.array([0.0, 0, 1]))
    other = planner.answer(mug, REQUEST, replace(table, surroundings=Surroundings(lower)))
    moved = planner.answer(
        mug, REQUEST, replace(table, surroundings=Surroundings(lower)), known=first
    )
    assert moved.result.phase_s["searching"] > 0.0
    assert moved.result.grasps[0].epsilon >= other.result.grasps[0].epsilon - 1e-12


def test_in_free_space_a_plan_for_a_table_is_not_lifted_off_it(planner, mug, table):
    """No support is known any more: the hand goes back the way it came."""
    on_table = planner.answer(mug, REQUEST, table).result
    assert all(grasp.lift_direction is not None for grasp in on_table.grasps)
    free = place_result(planner, mug, on_table, Place()).result
    assert free.grasps
    searched = planner.answer(mug, REQUEST, Place(), known=on_table).result
    for grasp in (*free.grasps, *searched.grasps):
        assert grasp.lift_direction is None
        assert grasp.way_out == pytest.approx(-grasp.T_object_palm[:3, 2])


def test_what_was_tried_counts_where_trials_are_wanted(planner, mug, plan):
    wanted = replace(REQUEST, verification="rank")
    untried = planner.known_answer(mug, plan, wanted, Place())
    assert not untried.satisfies(wanted)
    assert untried.satisfies(REQUEST)
    held = Trials((TrialOutcome("strict", True),))
    tried = replace(plan, grasps=(*plan.grasps[:-1], replace(plan.grasps[-1], trials=held)))
    known = planner.known_answer(mug, tried, wanted, Place())
    assert known.satisfies(wanted)
    assert known.answer.result.grasps[0].trials == held


def test_a_plan_of_another_mesh_is_refused(planner, plan):
    sphere = MeshCatalogue([default_catalogue_directory()]).load("sphere")
    with pytest.raises(RequestError, match="of this very mesh"):
        planner.known_answer(sphere, plan, REQUEST, Place())


@pytest.mark.parametrize(
    ("asked", "part_of", "what"),
    [
        ({"friction": Friction(0.05, 0.05)}, {}, "friction '0.3 / 0.2', now it is '0.05 / 0.05'"),
        ({"objective": "min_weight"}, {}, "objective 'paper', now it is 'min_weight'"),
        ({}, {"mass": 50.0}, "now it is '50 kg'"),
        ({}, {"center_of_mass": np.array([0.0, 0.0, 0.02])}, "centre of mass"),
    ],
)
def test_a_plan_for_something_else_is_refused(planner, mug, plan, asked, part_of, what):
    with pytest.raises(RequestError, match=what):
        planner.answer(replace(mug, **part_of), replace(REQUEST, **asked), known=plan)


def planner_with(group, **values):
    return GraspPlanner(replace(SETTINGS, **{group: replace(getattr(SETTINGS, group), **values)}))


@pytest.mark.parametrize(
    ("group", "name", "value", "said"),
    [
        ("scene", "cone_edges", 6, "scene.cone_edges 8, now it is 6"),
        ("scene", "contact_threshold_m", 0.001, "contact_threshold_m 0.0002, now it is 0.001"),
        ("hpp", "volume_weight", 0.1, "hpp.volume_weight 0.5, now it is 0.1"),
    ],
)
def test_a_plan_whose_figures_other_settings_made_is_refused(mug, plan, group, name, value, said):
    with pytest.raises(RequestError, match=said):
        planner_with(group, **{name: value}).known_answer(mug, plan, REQUEST, Place())


def test_trials_by_another_protocol_are_refused(mug, plan):
    """What held as 0.1 kg says nothing of 5 kg; how many processes tried it is all one."""
    held = Trials((TrialOutcome("strict", True),))
    tried = replace(plan, grasps=tuple(replace(grasp, trials=held) for grasp in plan.grasps))
    wanted = replace(REQUEST, verification="rank")
    heavy = planner_with("verification", mass_kg=5.0)
    with pytest.raises(RequestError, match=r"verification.mass_kg 0.1, now it is 5.0"):
        heavy.known_answer(mug, tried, wanted, Place())
    assert heavy.known_answer(mug, plan, REQUEST, Place()).satisfies(REQUEST)  # not tried
    alone = planner_with("verification", processes=1)
    assert alone.known_answer(mug, tried, wanted, Place()).satisfies(wanted)


def test_a_plan_of_another_hand_is_refused(mug, plan):
    jaw = GraspPlanner(PlannerSettings(hand=HandSettings(model="parallel_jaw")))
    with pytest.raises(RequestError, match=r"hand 'barrett_bh280', now it is 'parallel_jaw'"):
        jaw.answer(mug, REQUEST, known=plan)


def test_inside_rock_the_counts_are_told(planner, mug):
    request = replace(REQUEST, max_evaluations=64, n_grasps=2)
    answer = planner.answer(mug, request, Place(surroundings=ROCK))
    assert answer.result.code == ErrorCode.ALL_GRASPS_BLOCKED
    assert answer.result.grasps == ()
    attempts = answer.result.evaluations
    assert f"in {attempts} attempts {attempts} hands were blocked" in answer.result.message
