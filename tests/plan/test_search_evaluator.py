"""What a search closes hands with, by the settings."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.grasp.evaluator import AttemptStatus, PostureEvaluator
from gpis_grasp_planner.grasp.funnel import Step
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.plan.objective import make_objective
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.search_evaluator import search_evaluator
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.search.archive import Candidate


@pytest.mark.parametrize("kind", ["compiled", "bullet"])
@pytest.mark.parametrize("over", [False, True])
def test_it_counts_what_it_is_given_and_ends_with_the_time(kind: str, over: bool) -> None:
    part = MeshCatalogue([default_catalogue_directory()]).load("sphere")
    settings = PlannerSettings.from_mapping({"scene": {"search_evaluator": kind}})
    prepared = GraspPlanner(settings).prepare(part)
    made = search_evaluator(
        *(part, load_hand(), Friction(0.6, 0.6), settings, prepared),
        *((), make_objective(settings, part), lambda: over),
    )
    T = np.tile(np.eye(4), (40, 1, 1))
    # It looks at the ball, from near and far in turn.
    T[:, 2, 3] = part.center_of_mass[2] - np.tile(np.linspace(0.06, 0.16, 8), 5)
    with made as (evaluator, tally, exact):
        assert isinstance(evaluator, PostureEvaluator) == (kind == "compiled")
        found = evaluator.attempt(T, np.full((40, 1), 1.0))
        tried = 16 if over and kind == "compiled" else 40
        assert evaluator.n_attempts == tried
        assert tally.funnel(Step.CLEAR).proposed == tried
        candidate = Candidate(found, 0, 0.0)
        assert exact(candidate) is candidate  # nothing is simplified here
    assert (found.status[:tried] != AttemptStatus.NOT_TRIED).all()
    assert (found.n_contacts[:tried] > 0).any()
