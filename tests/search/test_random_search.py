"""The ablations: plain random palms, and charts without a model."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.search.random_search import RandomPalms, RandomWithAdaption


def test_random_palms_fill_the_shell_and_the_spread(
    sphere, make_context, recording_evaluator, planner
):
    evaluator = recording_evaluator()
    context = make_context(sphere, evaluator=evaluator)
    search = RandomPalms(context)
    for _ in range(10):
        search.step()
    assert [len(T) for T, _ in evaluator.attempts] == [32] * 10
    T = np.concatenate([T for T, _ in evaluator.attempts])
    spread = np.concatenate([s for _, s in evaluator.attempts])
    palm = planner.hand.link_names.index(planner.hand.palm_link)
    face_height = max(p.vertices[:, 2].max() for p in planner.hand.link_collision[palm])
    face = T[:, :3, 3] + face_height * T[:, :3, 2]
    lower, upper = sphere.mesh.bounds
    center, axes = (lower + upper) / 2, (upper - lower) / 2
    clearance = context.settings.hpp.palm_clearance_m
    assert np.all(np.linalg.norm((face - center) / axes, axis=1) >= 1.0 - 1e-9)
    assert np.all(np.linalg.norm((face - center) / (axes + clearance), axis=1) <= 1.0 + 1e-9)
    assert np.all((spread >= 0.0) & (spread <= np.pi))
    assert np.ptp(spread) > 0.9 * np.pi
    # Palms point anywhere: the mean of 320 even directions is short.
    assert np.linalg.norm(T[:, :3, 2].mean(axis=0)) < 0.35
    assert len(context.archive) == 320
    assert not search.finished


def test_random_proposals_are_adapted(sphere, make_context, recording_evaluator):
    settings = PlannerSettings.from_mapping({"hpp": {"batch": 3}, "adaption": {"n_seed": 7}})
    evaluator = recording_evaluator()
    context = make_context(sphere, settings=settings, evaluator=evaluator)
    search = RandomWithAdaption(context)
    search.step()
    search.step()
    assert evaluator.n_attempts == len(context.archive) == 2 * 3 * 7
    for T, normals, _, _ in evaluator.cleared:
        assert_allclose(T[:, :3, 2], -normals, atol=1e-12)
        # Seven seeds share one chart.
        assert len(np.unique(normals.round(9), axis=0)) == 3
    first, second = evaluator.attempts
    assert not np.allclose(first[0], second[0])
    assert not search.finished
