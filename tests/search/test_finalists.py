"""From the archive to the answer: exact figures, and a ranking by them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gpis_grasp_planner.search import finalists
from gpis_grasp_planner.search.finalists import choose_finalists, grasp_of


@pytest.fixture(scope="module")
def context(searched_mug):
    return searched_mug


@pytest.fixture(scope="module")
def grasps(context):
    return choose_finalists(context, 12, None)


def f_obj(grasp, context):
    return grasp.epsilon + context.settings.hpp.volume_weight * grasp.volume


def test_figures_are_those_of_the_full_hull(grasps, context, oracle):
    assert len(grasps) == 12
    scale = np.linalg.norm(context.part.mesh.vertices - context.part.center_of_mass, axis=1).max()
    for grasp in grasps:
        epsilon, volume = oracle.hull_figures(
            grasp.contacts, context.part.center_of_mass, scale, context.settings.scene.cone_edges
        )
        assert grasp.epsilon == pytest.approx(epsilon, rel=1e-6)
        assert grasp.volume == pytest.approx(volume, rel=1e-6)
        again = grasp.recomputed_quality(context.part.center_of_mass, scale, 8)
        assert (again.epsilon, again.volume) == (grasp.epsilon, grasp.volume)


def test_ranked_by_the_exact_objective(grasps, context):
    values = [f_obj(g, context) for g in grasps]
    assert values == sorted(values, reverse=True)
    assert all(g.epsilon > 0.0 and g.feasible for g in grasps)


def test_mutually_distinct(grasps, context, oracle):
    for a, first in enumerate(grasps):
        for second in grasps[a + 1 :]:
            difference = oracle.apart(
                first.T_object_palm, second.T_object_palm, context.part.max_radius
            )
            assert difference >= 0.2 - 1e-9


def test_the_chosen_are_the_best_of_a_quarter_more(context):
    # The spare quarter is computed exactly as well, and the best of all are taken.
    few = choose_finalists(context, 4, None)
    pool = [grasp_of(c, context) for c in context.archive.best(5)]
    expected = sorted((f_obj(g, context) for g in pool if g.feasible), reverse=True)[:4]
    assert [f_obj(g, context) for g in few] == expected


def test_search_figures_bound_the_exact_ones(context):
    for candidate in context.archive.best(15):
        assert grasp_of(candidate, context).epsilon <= candidate.epsilon * (1.0 + 1e-9)


def test_the_grasp_is_the_candidate(context, planner):
    candidate = context.archive.best(1)[0]
    grasp = grasp_of(candidate, context)
    attempts, i = candidate.attempts, candidate.index
    assert_allclose(grasp.T_object_palm, attempts.T_object_palm[i], atol=0.0)
    assert_allclose(grasp.joints, attempts.joints[i], atol=0.0)
    assert_allclose(grasp.approach_direction, grasp.T_object_palm[:3, 2], atol=0.0)
    assert grasp.approach_distance == context.settings.scene.retreat_m
    spreads = set(planner.hand.preshape.joints)
    for joint, angle in enumerate(grasp.pregrasp_joints):
        assert angle == (attempts.preshape[i, 0] if joint in spreads else 0.0)
    assert_allclose(grasp.joints[sorted(spreads)], attempts.preshape[i, 0], atol=1e-12)
    assert len(grasp.contacts) == attempts.n_contacts[i]


def test_the_answer_does_not_share_memory_with_the_search(context):
    candidate = context.archive.best(1)[0]
    before = candidate.attempts.joints[candidate.index].copy()
    grasp = grasp_of(candidate, context)
    grasp.joints[:] = 7.0
    grasp.T_object_palm[:] = 7.0
    grasp.contacts.positions[:] = 7.0
    assert_allclose(candidate.attempts.joints[candidate.index], before, atol=0.0)
    assert np.all(candidate.T_object_palm[3] == [0.0, 0.0, 0.0, 1.0])
    assert np.abs(candidate.attempts.positions).max() < 1.0


@pytest.mark.parametrize(("hulls", "expected"), [(0, 1), (1, 2), (3, 4), (100, 12)])
def test_no_hull_is_begun_after_the_deadline_but_the_first(hulls, expected, context, monkeypatch):
    clock = iter(range(10_000))
    monkeypatch.setattr(finalists.time, "monotonic", lambda: float(next(clock)))
    grasps = choose_finalists(context, 12, deadline=hulls - 0.5)
    assert len(grasps) == expected


def test_no_candidates_no_answer(make_context, sphere):
    assert choose_finalists(make_context(sphere), 5, None) == ()
