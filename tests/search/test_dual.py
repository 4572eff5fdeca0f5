"""The two stages in one budget."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.search.contacts.contact_first import ContactFirst
from gpis_grasp_planner.search.dual import DualOptimiser
from gpis_grasp_planner.search.hpp_opt import PalmPoseOptimiser
from gpis_grasp_planner.search.refinement.contact_refinement import ContactRefinement


@pytest.fixture
def stages(monkeypatch):
    """Attempts of the two stages, in order: list of (stage, Attempts)."""
    record = []

    def watch(cls, name, stage):
        watched = getattr(cls, name)

        def watch_archive(self, *args):
            add = self._context.archive.add
            object.__setattr__(
                self._context.archive,
                "add",
                lambda attempts: record.append((stage, attempts)) or add(attempts),
            )
            result = watched(self, *args)
            object.__delattr__(self._context.archive, "add")
            return result

        monkeypatch.setattr(cls, name, watch_archive)

    watch(PalmPoseOptimiser, "propose", 1)
    watch(ContactFirst, "attempt", 1)
    watch(ContactRefinement, "step", 2)
    return record


def run(context, n):
    search = DualOptimiser(context)
    while not search.finished and context.evaluator.n_attempts < n:
        search.step()
    return search


@pytest.mark.parametrize(("mesh_id", "seed"), [("bracket", 0), ("mug", 1)])
def test_the_best_is_never_worse_than_the_first_stages(
    mesh_id, seed, stages, make_context, catalogue
):
    context = make_context(catalogue.load(mesh_id), seed=seed)
    run(context, 300)
    objective = context.objective
    best = {
        stage: max(a.objective(objective).max(initial=0.0) for s, a in stages if s == stage)
        for stage in (1, 2)
    }
    assert min(best.values()) > 0.0
    assert context.archive.best(1)[0].objective == pytest.approx(max(best.values()), rel=1e-15)


@pytest.mark.parametrize("share", [0.0, 0.4, 0.9])
def test_the_second_stage_gets_its_share(share, stages, make_context, sphere, recording_evaluator):
    settings = PlannerSettings.from_mapping(
        {"dual": {"second_stage_share": share}, "adaption": {"n_seed": 25}}
    )
    context = make_context(sphere, settings=settings, evaluator=recording_evaluator())
    run(context, 4000)
    n = [sum(len(a) for s, a in stages if s == stage) for stage in (1, 2)]
    assert sum(n) == context.evaluator.n_attempts
    assert n[1] / sum(n) == pytest.approx(share, abs=0.05)


def test_the_second_stage_waits_for_a_grasp(stages, make_context, sphere, recording_evaluator):
    evaluator = recording_evaluator(figures=lambda T, spread: np.full(len(T), -1.0))
    context = make_context(sphere, evaluator=evaluator)
    run(context, 500)
    assert {stage for stage, _ in stages} == {1}


def test_without_a_grasp_it_ends_with_the_first_stage(make_context, sphere, recording_evaluator):
    settings = PlannerSettings.from_mapping(
        {"hpp": {"n_initial": 4, "n_iter": 3, "batch": 2}, "contacts": {"share": 0.0}}
    )
    evaluator = recording_evaluator(figures=lambda T, spread: np.full(len(T), -1.0))
    context = make_context(sphere, settings=settings, evaluator=evaluator)
    search = run(context, 10**9)
    assert search.finished
    assert evaluator.n_attempts == 7 * settings.adaption.n_seed


def test_after_the_first_stage_the_second_goes_on(
    stages, make_context, sphere, recording_evaluator
):
    settings = PlannerSettings.from_mapping({"hpp": {"n_initial": 2, "n_iter": 0}})
    context = make_context(sphere, settings=settings, evaluator=recording_evaluator())
    search = run(context, 400)
    assert not search.finished
    assert [stage for stage, _ in stages][-10:] == [2] * 10


@pytest.fixture
def hands_about_contacts(monkeypatch):
    """Attempts about contacts, in order."""
    record = []
    attempt = ContactFirst.attempt

    def watched(self, n_sets):
        attempts, owner = attempt(self, n_sets)
        record.append(attempts)
        return attempts, owner

    monkeypatch.setattr(ContactFirst, "attempt", watched)
    return record


@pytest.mark.parametrize("share", [0.0, 0.3, 0.8])
def test_contacts_get_their_share_of_the_first_stage(
    share, hands_about_contacts, make_context, sphere, recording_evaluator
):
    """Where all hands are worth the same."""
    settings = PlannerSettings.from_mapping(
        {"contacts": {"share": share}, "dual": {"second_stage_share": 0.0}}
    )
    context = make_context(sphere, settings=settings, evaluator=recording_evaluator())
    run(context, 4000)
    n = sum(len(attempts) for attempts in hands_about_contacts)
    assert n / context.evaluator.n_attempts == pytest.approx(share, abs=0.06)


def test_contacts_that_are_worth_little_get_less(
    hands_about_contacts, make_context, sphere, recording_evaluator
):
    """Palms on charts have values here; hands about contacts, the other calls, have none."""
    settings = PlannerSettings.from_mapping(
        {"contacts": {"share": 0.5}, "dual": {"second_stage_share": 0.0}}
    )
    about_contacts = []

    def figures(T, _):
        return np.full(len(T), -1.0 if about_contacts[-1:] == [True] else 0.1)

    context = make_context(sphere, settings=settings, evaluator=recording_evaluator(figures))
    watched = ContactFirst.attempt

    def attempt(self, n_sets):
        about_contacts.append(True)
        made = watched(self, n_sets)
        about_contacts.append(False)
        return made

    search = DualOptimiser(context)
    search._contacts.attempt = attempt.__get__(search._contacts)
    while context.evaluator.n_attempts < 4000:
        search.step()
    n = sum(len(attempts) for attempts in hands_about_contacts)
    assert 0 < n < 0.1 * context.evaluator.n_attempts


def test_without_force_closure_nothing_is_worth_anything(
    hands_about_contacts, make_context, sphere, recording_evaluator
):
    """A flat part on a table: clear hands have a volume before the first of them is a grasp."""
    settings = PlannerSettings.from_mapping(
        {"contacts": {"share": 0.3}, "dual": {"second_stage_share": 0.0}}
    )
    evaluator = recording_evaluator(lambda T, _: np.full(len(T), -1.0))
    context = make_context(sphere, settings=settings, evaluator=evaluator)
    search = DualOptimiser(context)
    closed = evaluator.attempt

    def with_volume(T, preshape):
        attempts = closed(T, preshape)
        # of palms alone, which the first stage closes by whole charts
        return replace(attempts, volume=np.where(len(T) > 40, 0.01, 0.0) * np.ones(len(T)))

    evaluator.attempt = with_volume
    while evaluator.n_attempts < 4000:
        search.step()
    n = sum(len(attempts) for attempts in hands_about_contacts)
    assert n / evaluator.n_attempts == pytest.approx(0.3, abs=0.06)


@pytest.mark.parametrize("tells", [False, True])
def test_the_model_learns_from_contacts_if_it_is_told(tells, make_context, sphere):
    settings = PlannerSettings.from_mapping(
        {"contacts": {"share": 1.0, "tell_model": tells}, "dual": {"second_stage_share": 0.0}}
    )
    context = make_context(sphere, settings=settings)
    search = DualOptimiser(context)
    for _ in range(3):
        search.step()
    of_palms = search._first.iterations
    assert of_palms < 3 * settings.hpp.batch
    assert (search._first._optimiser.n_observations > of_palms) is tells
