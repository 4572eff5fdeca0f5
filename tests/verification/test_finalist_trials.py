"""Finalists side by side: the same verdicts as one after the other, and a deadline that ends it."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
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
from gpis_grasp_planner.verification.protocol import prepare, verify
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
    """A child that answers at once; jobs (grasp, case) that are to fail are given."""

    def __init__(self, failing: set[tuple[int, int]]) -> None:
        self.connection = self
        self.jobs: list[tuple[int, int]] = []
        self._failing = failing

    def send(self, job: tuple[Grasp, Case]) -> None:
        self.jobs.append((place_number(job[0]), job[1].index))

    def recv(self) -> bool:
        return self.jobs[-1] not in self._failing

    def end(self) -> None:
        pass


class Case:
    """A case whose verdict is its outcome."""

    def __init__(self, index: int) -> None:
        self.index = index

    def outcome(self, passed: bool) -> TrialOutcome:
        return TrialOutcome("case", passed)


def numbered(firm: Grasp, n: int) -> list[Grasp]:
    """The firm grasp `n` times, a metre further with each."""
    made = []
    for k in range(n):
        T = firm.T_object_palm.copy()
        T[0, 3] = float(k)
        made.append(replace(firm, T_object_palm=T))
    return made


def place_number(grasp: Grasp) -> int:
    """Of a grasp of :func:`numbered`."""
    return round(grasp.T_object_palm[0, 3])


@pytest.fixture
def with_child(
    monkeypatch: pytest.MonkeyPatch, bar: Part, hand: HandDescription
) -> Callable[[set[tuple[int, int]]], tuple[FinalistTrials, Child]]:
    """Maker of trials whose only child answers at once; it is given which jobs fail."""

    def make(failing: set[tuple[int, int]]) -> tuple[FinalistTrials, Child]:
        field, tree = DistanceField.of(bar.mesh), TriangleTree.of(bar.mesh)
        prepare(bar, SETTINGS, field, tree)
        child = Child(failing)
        monkeypatch.setattr(finalist_trials, "wait", lambda ready, _: ready)
        monkeypatch.setattr(finalist_trials, "ForkedChild", lambda _: child)
        return FinalistTrials(bar, hand, replace(SETTINGS, processes=1), field, tree), child

    return make


def test_the_deciding_case_of_the_best_comes_first_and_low_ranks_do_not_starve(
    with_child: Callable[..., tuple[FinalistTrials, Child]], firm: Grasp
) -> None:
    trials, child = with_child({(1, 0)})
    made = trials.run(numbered(firm, 7), [Case(0), Case(1)], None)
    assert [grasp for grasp, case in child.jobs if case == 0] == list(range(7))
    # grasp 0's second case waits for the first of grasps 1 to 3
    assert child.jobs.index((0, 1)) == 4
    # what does not hold is not tried further
    assert [len(of.outcomes) for of in made if of] == [2, 1, 2, 2, 2, 2, 2]


def test_a_grasp_that_failed_a_further_case_waits(
    with_child: Callable[..., tuple[FinalistTrials, Child]], firm: Grasp
) -> None:
    trials, child = with_child({(0, 1)})
    made = trials.run(numbered(firm, 4), [Case(k) for k in range(4)], None)
    assert child.jobs.index((0, 2)) > child.jobs.index((3, 2))
    assert [len(of.outcomes) for of in made if of] == [4, 4, 4, 4]


def test_what_is_offered_anew_takes_the_place_of_what_was_not_begun(
    with_child: Callable[..., tuple[FinalistTrials, Child]], firm: Grasp
) -> None:
    trials, child = with_child(set())
    grasps, cases = numbered(firm, 6), [Case(0)]
    trials.offer(grasps[:3], cases)
    trials.poll()  # 0 is answered, 1 is begun
    trials.offer(grasps[3:], cases)
    while trials.busy:
        trials.poll()
    assert [grasp for grasp, _ in child.jobs] == [0, 1, 3, 4, 5]
    # What was tried is remembered, whether it is offered or not, and not tried again.
    assert [place_number(g) for g in trials.held] == [0, 1, 3, 4, 5]
    made = trials.run(grasps, cases, None)
    assert [grasp for grasp, _ in child.jobs] == [0, 1, 3, 4, 5, 2]
    assert all(of is not None for of in made)


@pytest.mark.parametrize("fault", [signal.SIGKILL, signal.SIGSEGV, signal.SIGSTOP])
def test_a_child_that_dies_or_hangs_costs_its_own_trial_only(
    bar: Part, hand: HandDescription, firm: Grasp, rng: np.random.Generator, fault: signal.Signals
) -> None:
    """15 grasps; the children of some are struck at a random moment of their trial."""
    field, tree = DistanceField.of(bar.mesh), TriangleTree.of(bar.mesh)
    prepare(bar, SETTINGS, field, tree)
    settings = replace(SETTINGS, trial_limit_s=3.0, processes=2)
    trials = FinalistTrials(bar, hand, settings, field, tree)
    grasps = [replace(firm, pregrasp_joints=firm.pregrasp_joints + 1e-6 * k) for k in range(15)]
    cases = finalist_cases(bar, Friction(0.6, 0.6), settings, seed=0)[:1]
    trials.offer(grasps, cases)
    struck: set[int] = set()
    while trials.busy:
        trials.poll(timeout_s=float(rng.uniform(0.0, 0.1)))
        at_work = [worker for worker in trials._workers if worker.record is not None]
        if at_work and len(struck) < 3 and rng.random() < 0.3:
            pid = at_work[-1].child.pid
            if pid not in struck:
                struck.add(pid)
                os.kill(pid, fault)
    made = trials.run(grasps, cases, None)
    lost = sum(of is None for of in made)
    assert 1 <= lost <= 3
    assert all(of.held for of in made if of is not None)
    why = "took more than 3 s" if fault is signal.SIGSTOP else f"ended by signal {int(fault)}"
    assert why in trials.why_untried
    trials.close()
    assert not trials._workers
    for pid in struck:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_a_cover_whose_process_was_killed_leaves_the_grasps_untried(
    make_box: Callable[[float, float, float], Part], hand: HandDescription, firm: Grasp
) -> None:
    box = make_box(0.05, 0.06, 0.0722)
    trials = FinalistTrials(
        box, hand, SETTINGS, DistanceField.of(box.mesh), TriangleTree.of(box.mesh)
    )
    assert trials._cover is not None
    os.kill(trials._cover.pid, signal.SIGKILL)
    cases = finalist_cases(box, Friction(0.6, 0.6), SETTINGS, seed=0)
    assert trials.run([firm], cases, deadline=None) == [None]
    assert "signal 9" in trials.why_untried


def test_the_cover_is_made_once(
    bar: Part, hand: HandDescription, make_box: Callable[[float, float, float], Part]
) -> None:
    box = make_box(0.05, 0.06, 0.0711)
    field, tree = DistanceField.of(box.mesh), TriangleTree.of(box.mesh)
    first = FinalistTrials(box, hand, SETTINGS, field, tree)
    assert first._cover is not None
    prepared = first._wait_for_cover(60.0)
    first.close()
    assert prepared is not None
    again = FinalistTrials(box, hand, SETTINGS, field, tree)
    assert again._cover is None
    assert again._prepared is prepared
