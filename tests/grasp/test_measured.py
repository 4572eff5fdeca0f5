"""Attempts with the figures of measures: the same attempts, each measured where it is a grasp."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from gpis_grasp_planner.grasp.evaluator import AttemptStatus, PostureEvaluator
from gpis_grasp_planner.grasp.measured import with_figures, with_measures
from gpis_grasp_planner.grasp.open_hand import open_postures
from gpis_grasp_planner.quality.figures import Figure
from gpis_grasp_planner.quality.least_friction import LEAST_FRICTION
from gpis_grasp_planner.quality.measure import HeldPart, Measure
from gpis_grasp_planner.quality.min_weight import MIN_WEIGHT, min_weight_of
from gpis_grasp_planner.quality.objective import OneMeasure
from gpis_grasp_planner.quality.wrench_space import contact_wrenches
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.search.finalists import choose_finalists
from gpis_grasp_planner.search.searches import make_search

EDGES = 8


@pytest.fixture(scope="module")
def plain(planner, sphere):
    """The compiled evaluator of the ball."""
    prepared = planner.prepare(sphere)
    return CompiledEvaluator(
        planner.hand, sphere, sphere.friction, planner.settings.scene, prepared.field, prepared.tree
    )


@pytest.fixture(scope="module")
def context(sphere, make_context, plain):
    """A context with forty grasps."""
    context = make_context(sphere, seed=3, evaluator=plain)
    search = make_search("random-adaption", context)
    while len(context.archive) < 40:
        search.step()
    return context


@pytest.fixture(scope="module")
def poses(context):
    """Poses and spreads, half of them grasps."""
    candidates = context.archive.best(30, 0.05)
    T = np.stack([c.T_object_palm for c in candidates])
    moved = T.copy()
    moved[:, :3, 3] += 0.05 * moved[:, :3, 0]
    spread = np.array([c.preshape for c in candidates])
    return np.concatenate([T, moved]), np.concatenate([spread, spread])


def test_without_measures_nothing_stands_between(plain, sphere):
    assert with_measures(plain, (), sphere, EDGES) is plain


@pytest.mark.parametrize("way", ["attempt", "attempt_from"])
def test_attempts_are_the_plain_ones_with_columns(planner, plain, sphere, poses, way):
    measuring = with_measures(plain, (MIN_WEIGHT, LEAST_FRICTION), sphere, EDGES)
    assert isinstance(measuring, PostureEvaluator)
    T, spread = poses
    how = spread if way == "attempt" else open_postures(planner.hand, spread)
    before, after = getattr(plain, way)(T, how), getattr(measuring, way)(T, how)
    for field in fields(before):
        if field.name != "columns" and getattr(before, field.name) is not None:
            np.testing.assert_array_equal(getattr(before, field.name), getattr(after, field.name))
    closed = (after.status == AttemptStatus.GRASPED) & (after.epsilon > 0.0)
    assert 0 < closed.sum() < len(T)
    values = after.measured["min_weight"]
    np.testing.assert_array_equal(np.isfinite(values), closed)
    for i in np.flatnonzero(closed):
        W = contact_wrenches(after.contacts(i), sphere.center_of_mass, sphere.max_radius, EDGES)
        assert values[i] == min_weight_of(W)
        quality = after.quality(i)
        assert quality.measured["min_weight"] == values[i]
        assert 0.0 < quality.measured["least_friction"] <= after.friction[i].max()
    objective = after.objective(OneMeasure(MIN_WEIGHT))
    np.testing.assert_array_equal(objective, np.where(closed, np.nan_to_num(values), 0.0))


def test_a_measure_sees_the_hand_and_the_part(plain, sphere, poses):
    seen: list[HeldPart] = []

    def of(held: HeldPart) -> float:
        seen.append(held)
        return 1.0

    own = Measure(Figure("own", "", True, "", ""), of)
    after = with_measures(plain, (own,), sphere, EDGES).attempt(*poses)
    rows = np.flatnonzero(np.isfinite(after.measured["own"]))
    assert len(seen) == len(rows) > 0
    for held, i in zip(seen, rows, strict=True):
        np.testing.assert_array_equal(held.T_object_palm, after.T_object_palm[i])
        np.testing.assert_array_equal(held.joints, after.joints[i])
        np.testing.assert_array_equal(held.contacts.positions, after.contacts(i).positions)
        assert held.torque_scale == sphere.max_radius


def test_finished_grasps_have_figures_and_no_grasp_has_none(context, sphere):
    grasp = choose_finalists(context, 1, None)[0]
    place = sphere.center_of_mass, sphere.max_radius, EDGES
    with_one = with_figures(grasp, (MIN_WEIGHT,), *place)
    assert set(with_one.quality.measured) == {"min_weight"}
    both = with_figures(with_one, (LEAST_FRICTION,), *place)
    assert set(both.quality.measured) == {"min_weight", "least_friction"}
    assert both.quality.figures["epsilon"] == grasp.epsilon
    loose = replace(grasp, quality=replace(grasp.quality, epsilon=-1.0))
    assert with_figures(loose, (MIN_WEIGHT,), *place) is loose
