"""A search that knows the table: the plain evaluator's attempts, less the blocked ones."""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.grasp.evaluator import AttemptStatus, PostureEvaluator
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.search.finalists import choose_finalists
from gpis_grasp_planner.search.searches import make_search
from gpis_grasp_planner.surroundings.clear_evaluator import ClearEvaluator
from gpis_grasp_planner.surroundings.clearance_settings import ClearanceSettings
from gpis_grasp_planner.surroundings.obstacles import SupportPlane, Surroundings

RADIUS = 0.035
TABLE = Surroundings(SupportPlane(np.array([0.0, 0.0, -RADIUS]), np.array([0.0, 0.0, 1.0])))
SETTINGS = ClearanceSettings()


def evaluators(planner, part):
    prepared = planner.prepare(part)
    scene = planner.settings.scene
    plain = CompiledEvaluator(
        planner.hand, part, part.friction, scene, prepared.field, prepared.tree
    )
    return plain, ClearEvaluator(plain, planner.hand, TABLE, SETTINGS, scene.retreat_m)


def test_attempts_are_the_plain_ones_less_the_blocked(planner, sphere, make_context):
    plain, clear = evaluators(planner, sphere)
    assert isinstance(clear, PostureEvaluator)
    context = make_context(sphere, seed=3, evaluator=plain)
    search = make_search("random-adaption", context)
    while len(context.archive) < 40:
        search.step()
    candidates = context.archive.best(60, 0.05)
    T = np.stack([c.T_object_palm for c in candidates])
    spread = np.array([c.spread for c in candidates])
    before, after = plain.attempt(T, spread), clear.attempt(T, spread)
    blocked = after.status == AttemptStatus.BLOCKED
    assert 0 < blocked.sum() < len(T)
    assert clear.blocked.total() == blocked.sum()
    assert clear.n_attempts == plain.n_attempts
    for name in ("joints", "n_contacts", "positions"):
        np.testing.assert_array_equal(getattr(before, name), getattr(after, name))
    np.testing.assert_array_equal(before.epsilon[~blocked], after.epsilon[~blocked])
    assert (before.epsilon[blocked] > 0.0).all()
    assert (after.objective(0.1)[blocked] == 0.0).all()


def test_a_search_on_it_answers_with_clear_grasps_only(planner, sphere, make_context, referee):
    _, clear = evaluators(planner, sphere)
    context = make_context(sphere, seed=4, evaluator=clear)
    search = make_search("hpp", context)
    while clear.n_attempts < 500:
        search.step()
    grasps = choose_finalists(context, 10, None)
    assert len(grasps) >= 5
    assert clear.blocked.total() > 0
    for grasp in grasps:
        for poses in referee.way(grasp, n_back=5, n_closing=15):
            lowest = min(
                (poses[link][:3, :3] @ np.array(piece.vertices).T)[2].min() + poses[link][2, 3]
                for link, pieces in enumerate(planner.hand.link_collision)
                for piece in pieces
            )
            assert lowest >= -RADIUS + SETTINGS.margin_m - 1e-9
