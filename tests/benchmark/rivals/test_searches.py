"""The rival planners as wholes: repeatable, legal, and able to find grasps."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gpis_grasp_benchmark.rivals.eigengrasp import EigenGraspAnnealing
from gpis_grasp_benchmark.rivals.settings import RivalSettings
from gpis_grasp_benchmark.rivals.two_level import TwoLevelAnnealing
from gpis_grasp_planner.grasp.evaluator import AttemptStatus
from gpis_grasp_planner.search.finalists import choose_finalists
from gpis_grasp_planner.search.searches import (
    PLANNERS,
    check_planner,
    make_search,
    planner_names,
    registered,
)

RIVALS = ("annealing", "eigengrasp", "eigengrasp-two-level")


def run(context, name, steps):
    search = make_search(name, context)
    for _ in range(steps):
        search.step()
    assert not search.finished
    return search


def archived(context):
    return context.archive.best(50, apart=0.0)


def test_they_are_known_by_name():
    """By entry points alone: the planner's own names are others."""
    assert set(RIVALS) == set(registered())
    assert planner_names() == (*PLANNERS, *RIVALS)
    assert not set(RIVALS) & set(PLANNERS)
    assert [check_planner(name) for name in RIVALS] == list(RIVALS)


@pytest.mark.parametrize("name", RIVALS)
def test_the_same_seed_gives_the_same_search(name, sphere, make_context):
    def figures(seed):
        context = make_context(sphere, seed=seed)
        run(context, name, 12)
        best = archived(context)
        return context.evaluator.n_states, context.evaluator.n_attempts, [c.epsilon for c in best]

    first = figures(5)
    assert figures(5) == first
    assert figures(6) != first


def steps_to_force_closure(context, name, limit):
    search = make_search(name, context)
    for step in range(1, limit + 1):
        search.step()
        if len(context.archive):
            return step
    return limit + 1


@pytest.mark.parametrize(
    ("name", "limit"), [("annealing", 150), ("eigengrasp", 20), ("eigengrasp-two-level", 50)]
)
def test_force_closure_of_a_ball(name, limit, sphere, make_context):
    """Within 4800 closed hands, 2560 states, or 5000 states with 1250 closed hands."""
    for seed in range(2):
        context = make_context(sphere, seed=seed)
        assert steps_to_force_closure(context, name, limit) <= limit, seed


@pytest.mark.parametrize(("name", "limit"), [("eigengrasp", 50), ("eigengrasp-two-level", 40)])
def test_force_closure_of_a_catalogue_part(name, limit, catalogue, make_context):
    """A hub of steel; annealing on the quality alone finds nothing here in 3840 closed hands."""
    part = catalogue.load("coupling_hub")
    context = make_context(part, seed=1, friction=part.friction)
    assert steps_to_force_closure(context, name, limit) <= limit
    grasps = choose_finalists(context, 3, None)
    assert grasps
    assert grasps[0].epsilon > 0.0


def test_archived_grasps_are_legal(sphere, make_context, oracle):
    """Contacts lie on the ball, the hand nowhere in it, closed and before it closed."""
    context = make_context(sphere, seed=3)
    run(context, "eigengrasp-two-level", 30)
    candidates = archived(context)[:4]
    assert candidates
    ball = sphere.mesh.vertices
    for candidate in candidates:
        attempts, i = candidate.attempts, candidate.index
        assert attempts.status[i] == AttemptStatus.GRASPED
        contacts = attempts.contacts(i)
        radii = np.linalg.norm(contacts.positions, axis=1)
        assert np.all((radii > 0.0345) & (radii <= 0.035 + 1e-9))
        hand_points = 0
        for joints in (attempts.joints[i], attempts.start_joints[i]):
            for pieces in oracle.posed_links(context.hand, attempts.T_object_palm[i], joints):
                for piece in pieces:
                    assert not oracle.convex_overlap(piece, ball)
                    hand_points += len(piece)
        assert hand_points > 100


def test_the_answer_closes_from_the_states_posture(sphere, make_context):
    context = make_context(sphere, seed=3)
    run(context, "eigengrasp-two-level", 30)
    grasp = choose_finalists(context, 1, None)[0]
    again = context.evaluator.attempt_from(grasp.T_object_palm[None], grasp.pregrasp_joints[None])
    assert_allclose(again.joints[0], grasp.joints, atol=1e-12)
    assert np.any(grasp.pregrasp_joints[2:] > 0.0)


def test_eigengrasp_closes_every_state_of_its_list_once(sphere, make_context):
    context = make_context(sphere, seed=2)
    search = EigenGraspAnnealing(context)
    for _ in range(15):
        before = list(search.best.entries)
        attempts = context.evaluator.n_attempts
        search.step()
        fresh = [entry for entry in search.best.entries if entry not in before]
        assert all(entry.closed for entry in search.best.entries)
        assert context.evaluator.n_attempts - attempts == len(fresh)
    assert len(search.best) > 5


def test_the_parent_keeps_away_from_seeds_and_what_children_found(sphere, make_context, oracle):
    context = make_context(sphere, seed=4)
    search = TwoLevelAnnealing(context, RivalSettings(child_steps=5))
    radius = context.max_radius
    avoided, queued = [], []
    for _ in range(30):
        known = list(queued)
        search.step()
        queued = [entry.T_object_face for entry in search.seeds.entries]
        for i, a in enumerate(queued):
            assert all(oracle.apart(a, b, radius) >= 0.3 - 1e-9 for b in queued[:i])
            if not any(a is b for b in known):
                assert all(oracle.apart(a, b, radius) >= 0.3 - 1e-9 for b in avoided)
        avoided = list(search.avoided)
    assert search.n_children >= 3
    assert len(avoided) >= 2 * search.n_children - 1
