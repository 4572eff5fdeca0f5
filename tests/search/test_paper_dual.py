"""Alg. 4 as printed: both stages for every proposal, and what the model is told."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.search.paper_dual import PaperDualOptimiser


@pytest.fixture(scope="module")
def run(make_context, sphere):
    """Four iterations with short sub-problems: (search, told, results by iteration)."""
    settings = PlannerSettings.from_mapping(
        {
            "hpp": {"n_initial": 3, "n_iter": 1},
            "admm": {"max_iterations": 2, "first_evaluations": 8, "update_evaluations": 2},
        }
    )
    context = make_context(sphere, seed=1, settings=settings)
    search = PaperDualOptimiser(context)
    told, results = [], []
    propose, tell, optimise = search._first.propose, search._first.tell, search._second.optimise
    search._first.propose = lambda n: told.append([propose(n)]) or told[-1][0]
    first_values = []

    def watched_optimise(*arguments):
        first_values.append(told[-1][0].values.copy())
        results.append((len(told) - 1, optimise(*arguments)))
        return results[-1][1]

    search._second.optimise = watched_optimise
    search._first.tell = lambda proposals: told[-1].append(proposals) or tell(proposals)
    while not search.finished:
        search.step()
    return search, context, told, results, first_values


def test_one_proposal_an_iteration_until_n_iter(run):
    search, _, told, _, _ = run
    assert search.finished
    assert [len(proposals.X) for proposals, _ in told] == [1] * 4


def test_the_told_value_is_the_better_stages_at_its_own_pose(run):
    _, context, told, results, first_values = run
    assert results
    objective = context.objective
    face_height = context.T_palm_face[2, 3]
    for (iteration, found), first in zip(results, first_values, strict=True):
        _, proposals = told[iteration]
        best = int(proposals.best[0])
        choices = [(float(first[0]), proposals.attempts.T_object_palm[best])]
        choices += [(float(r.realised.objective(objective)[0]), r.T_object_palm) for r in found]
        value, T = max(choices, key=lambda choice: choice[0])
        assert proposals.values[0] == pytest.approx(value, rel=1e-15)
        assert proposals.values[0] >= first[0]
        face = T.copy()
        face[:3, 3] += face_height * T[:3, 2]
        assert_allclose(proposals.T_object_face[0], face, atol=1e-15)


def test_counts_are_those_of_the_results(run):
    search, context, _, results, first_values = run
    objective = context.objective
    flat = [
        (r, first[0])
        for (_, found), first in zip(results, first_values, strict=True)
        for r in found
    ]
    assert search.runs == len(flat) == context.settings.admm.n_seed * len(results)
    assert search.converged == sum(r.converged for r, _ in flat)
    assert search.improved == sum(r.realised.objective(objective)[0] > v for r, v in flat)


def test_the_answer_is_never_worse_than_the_first_stages(run):
    _, context, told, results, _ = run
    objective = context.objective
    first = max(p.attempts.objective(objective).max(initial=0.0) for p, _ in told)
    second = max(r.realised.objective(objective)[0] for _, found in results for r in found)
    best = context.archive.best(1)[0].objective
    assert best == pytest.approx(max(first, second), rel=1e-15)


def test_without_a_grasp_the_second_stage_does_not_run(make_context, sphere, recording_evaluator):
    evaluator = recording_evaluator(figures=lambda T, spread: np.full(len(T), -1.0))
    search = PaperDualOptimiser(make_context(sphere, evaluator=evaluator))
    for _ in range(3):
        search.step()
    assert (search.runs, search.converged, search.improved) == (0, 0, 0)
    assert len(search._context.archive) == 0
