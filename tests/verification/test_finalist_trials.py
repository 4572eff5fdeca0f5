"""Finalists side by side: the same verdicts as one after the other, and a deadline that ends it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest

from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.trials import TrialOutcome
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.verification import finalist_trials
from gpis_grasp_planner.verification.cases import finalist_cases
from gpis_grasp_planner.verification.finalist_trials import FinalistTrials
from gpis_grasp_planner.verification.protocol import verify
from gpis_grasp_planner.verification.settings import VerificationSettings

SETTINGS = VerificationSettings(noise_repeats=1)


@pytest.fixture
def trials(bar: Part, hand: HandDescription) -> Iterator[FinalistTrials]:
    """Trials of the bar."""
    made = FinalistTrials(
        bar, hand, SETTINGS, DistanceField.of(bar.mesh), TriangleTree.of(bar.mesh)
    )
    yield made
    made.close()


@pytest.fixture
def beside(firm: Grasp) -> Grasp:
    """The firm grasp, 0.2 m beside the bar: nothing touches."""
    T = firm.T_object_palm.copy()
    T[0, 3] += 0.2
    return replace(firm, T_object_palm=T)


def test_verdicts_are_those_of_the_protocol(
    trials: FinalistTrials, bar: Part, hand: HandDescription, firm: Grasp, beside: Grasp
) -> None:
    cases = finalist_cases(bar, Friction(0.6, 0.6), SETTINGS, seed=0)
    good, bad = trials.run([firm, beside], cases, deadline=None)
    assert good is not None
    assert bad is not None
    assert [outcome.name for outcome in good.outcomes] == [case.name for case in cases]
    assert good.held
    for case, outcome in zip(cases, good.outcomes, strict=True):
        moves = None if case.displacement is None else [case.displacement]
        [alone] = verify(bar, hand, [firm], case.settings, displacements=moves)
        assert outcome.passed == alone.held
        assert outcome.cause == alone.cause
        assert outcome.slip_m == pytest.approx(1e-3 * alone.largest_slip_mm, abs=1e-4)
    assert not bad.held
    assert len(bad.outcomes) == 1  # what does not hold is not tried further
    assert bad.outcomes[0].cause == "too few touch"


def test_nothing_is_tried_after_the_deadline(
    trials: FinalistTrials, bar: Part, firm: Grasp
) -> None:
    cases = finalist_cases(bar, Friction(0.6, 0.6), SETTINGS, seed=0)
    assert trials.run([firm], cases, deadline=time.monotonic() - 1.0) == [None]
    assert trials.run([firm], cases, None, should_stop=lambda: True) == [None]
    assert trials.run([], cases, deadline=None) == []


class Child:
    """A child that answers at once; jobs that are to fail are given."""

    def __init__(self, failing: set[tuple[int, int]]) -> None:
        self.connection = self
        self.jobs: list[tuple[int, int]] = []
        self._failing = failing

    def send(self, job: tuple[int, int]) -> None:
        self.jobs.append(job)

    def recv(self) -> bool:
        return self.jobs[-1] not in self._failing


class Case:
    """A case whose verdict is its outcome."""

    def outcome(self, passed: bool) -> TrialOutcome:
        return TrialOutcome("case", passed)


def order_of_jobs(
    monkeypatch: pytest.MonkeyPatch, n_grasps: int, n_cases: int, failing: set[tuple[int, int]]
) -> tuple[list[tuple[int, int]], list[int]]:
    """Pairs of grasp and case in the order in which one child gets them; outcomes per grasp."""
    monkeypatch.setattr(finalist_trials, "wait", lambda ready, _: ready)
    outcomes: list[list[TrialOutcome]] = [[] for _ in range(n_grasps)]
    child = Child(failing)
    finalist_trials._share_out([child], n_grasps, [Case()] * n_cases, outcomes, lambda: False)
    return child.jobs, [len(of_grasp) for of_grasp in outcomes]


def test_the_deciding_case_of_the_best_comes_first_and_low_ranks_do_not_starve(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    order, made = order_of_jobs(monkeypatch, 7, 2, failing={(1, 0)})
    assert [grasp for grasp, case in order if case == 0] == list(range(7))
    # grasp 0's second case waits for the first of grasps 1 to 3
    assert order.index((0, 1)) == 4
    # what does not hold is not tried further
    assert made == [2, 1, 2, 2, 2, 2, 2]


def test_a_grasp_that_failed_a_further_case_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    order, made = order_of_jobs(monkeypatch, 4, 4, failing={(0, 1)})
    assert order.index((0, 2)) > order.index((3, 2))
    assert made == [4, 4, 4, 4]


def test_the_cover_is_made_once(
    bar: Part, hand: HandDescription, make_box: Callable[[float, float, float], Part]
) -> None:
    box = make_box(0.05, 0.06, 0.0711)
    field, tree = DistanceField.of(box.mesh), TriangleTree.of(box.mesh)
    first = FinalistTrials(box, hand, SETTINGS, field, tree)
    assert first._cover is not None
    prepared = first._wait_for_cover(lambda: False)
    first.close()
    assert prepared is not None
    again = FinalistTrials(box, hand, SETTINGS, field, tree)
    assert again._cover is None
    assert again._prepared is prepared
