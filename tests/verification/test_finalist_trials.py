"""Finalists side by side: the same verdicts as one after the other, and a deadline that ends it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.planning.grasp import Grasp
from gpis_grasp_planner.planning.verification_settings import VerificationSettings
from gpis_grasp_planner.verification import finalist_trials
from gpis_grasp_planner.verification.cases import finalist_cases
from gpis_grasp_planner.verification.finalist_trials import FinalistTrials
from gpis_grasp_planner.verification.protocol import verify

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


def test_the_deciding_case_of_the_best_comes_first_and_low_ranks_do_not_starve(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    order: list[tuple[int, int]] = []

    class Child:
        """Answers at once: grasp 1 fails its first case."""

        def __init__(self) -> None:
            self.connection = self
            self._job = (0, 0)

        def send(self, job: tuple[int, int]) -> None:
            order.append(job)
            self._job = job

        def recv(self) -> bool:
            return self._job != (1, 0)

    class Case:
        def outcome(self, passed: bool) -> finalist_trials.TrialOutcome:
            return finalist_trials.TrialOutcome("case", passed)

    monkeypatch.setattr(finalist_trials, "wait", lambda ready, _: ready)
    outcomes: list[list[finalist_trials.TrialOutcome]] = [[] for _ in range(7)]
    finalist_trials._share_out([Child()], 7, [Case(), Case()], outcomes, lambda: False)
    first = [grasp for grasp, case in order if case == 0]
    assert first == list(range(7))
    assert (1, 1) not in order
    # grasp 0's second case waits for the first of grasps 1 to 4
    assert order.index((0, 1)) == 4
    assert np.array_equal([len(o) for o in outcomes], [2, 1, 2, 2, 2, 2, 2])


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
