"""The second stage in its improved form: three searches that take turns."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.search.refinement.contact_refinement import ContactRefinement
from gpis_grasp_planner.search.refinement.grasp_images import GraspImages
from gpis_grasp_planner.search.refinement.list_refinement import ListRefinement
from gpis_grasp_planner.search.refinement.start_tournament import StartTournament

KINDS = {"list": ListRefinement, "tournament": StartTournament, "images": GraspImages}


@pytest.fixture
def turns(monkeypatch):
    """Names of the searches in the order of their turns; `able` says who has something to do."""

    class Turns(list):
        def __init__(self):
            super().__init__()
            self.able = set(KINDS)

    record = Turns()
    for name, cls in KINDS.items():

        def step(self, name=name):
            if name in record.able:
                record.append(name)
            return name in record.able

        monkeypatch.setattr(cls, "step", step)
    return record


@pytest.fixture
def refinement(sphere, make_context, recording_evaluator, oracle):
    """A refinement over one grasp, with shares of one's choice."""

    def make(**shares):
        settings = PlannerSettings.from_mapping({"refinement": shares})
        context = make_context(sphere, settings=settings, evaluator=recording_evaluator())
        context.archive.add(oracle.make_attempts(np.eye(4)[None], [0.1]))
        return ContactRefinement(context)

    return make


@pytest.mark.parametrize(
    ("tournament", "images"), [(0.38, 0.25), (0.5, 0.1), (0.2, 0.0), (0.0, 0.0), (0.5, 0.5)]
)
def test_turns_follow_the_shares(refinement, turns, tournament, images):
    it = refinement(tournament_share=tournament, image_share=images)
    for n in range(1, 301):
        it.step()
        for name, share in (
            ("tournament", tournament),
            ("images", images),
            ("list", 1.0 - tournament - images),
        ):
            assert abs(turns.count(name) - share * n) < 1.5
    assert len(turns) == 300


def test_who_has_nothing_to_do_leaves_its_turn_to_the_others(refinement, turns):
    it = refinement(tournament_share=0.4, image_share=0.2)
    turns.able = {"list", "tournament"}
    for _ in range(100):
        it.step()
    assert len(turns) == 100
    assert turns.count("list") == pytest.approx(50, abs=15)
    # It does not make up for the turns it has left.
    turns.able = set(KINDS)
    turns.clear()
    for _ in range(100):
        it.step()
    assert turns.count("images") == pytest.approx(20, abs=2)


def test_nothing_to_refine_is_nothing_done(sphere, make_context, recording_evaluator):
    evaluator = recording_evaluator()
    refinement = ContactRefinement(make_context(sphere, evaluator=evaluator))
    assert not refinement.ready
    refinement.step()
    assert evaluator.n_attempts == 0


def test_a_real_grasp_gets_better(make_context, sphere):
    context = make_context(sphere, seed=3)
    T = np.eye(4)
    T[:3, :3] = np.diag([1.0, -1.0, -1.0])
    T[2, 3] = 0.035 + context.T_palm_face[2, 3] + 0.04
    attempts = context.evaluator.attempt(T[None], np.array([[np.pi / 3]]))
    context.archive.add(attempts)
    first = context.archive.best(1)[0].objective
    refinement = ContactRefinement(context)
    refinement.consider(attempts)
    assert refinement.ready
    for _ in range(30):
        refinement.step()
    assert context.archive.best(1)[0].objective > 2.0 * first
