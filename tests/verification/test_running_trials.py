"""Trials beside a search: the protocol's verdicts, best first, and children that may die."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.geometry.uncertainty import SurfaceUncertainty
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.trials import TrialOutcome, Trials
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.verification import running_trials
from gpis_grasp_planner.verification.cases import finalist_cases
from gpis_grasp_planner.verification.convex_cover import ConvexCover, Piece
from gpis_grasp_planner.verification.protocol import PreparedPart, verify
from gpis_grasp_planner.verification.running_trials import RunningTrials
from gpis_grasp_planner.verification.settings import VerificationSettings

SETTINGS = VerificationSettings(draws=1)
FAULTS = 15


def never() -> bool:
    return False


@pytest.fixture
def prepared(bar: Part) -> PreparedPart:
    field, tree = DistanceField.of(bar.mesh), TriangleTree.of(bar.mesh)
    return PreparedPart(field, tree, ConvexCover(bar.mesh, field, tree))


@pytest.fixture
def make(
    bar: Part, hand: HandDescription, prepared: PreparedPart
) -> Iterator[Callable[..., RunningTrials]]:
    """Maker of trials of the bar; all are closed at the end."""
    made: list[RunningTrials] = []

    def start(settings: VerificationSettings = SETTINGS, **options: object) -> RunningTrials:
        cases = finalist_cases(bar, Friction(0.6, 0.6), settings, seed=0)
        made.append(RunningTrials(bar, hand, settings, prepared, cases, **options))
        return made[-1]

    yield start
    for trials in made:
        trials.close()


@pytest.fixture
def beside(firm: Grasp) -> Grasp:
    """The firm grasp, 0.2 m beside the bar: nothing touches."""
    T = firm.T_object_palm.copy()
    T[0, 3] += 0.2
    return replace(firm, T_object_palm=T)


def shifted(grasp: Grasp, i: int) -> Grasp:
    """The same grasp along the bar by i tenths of a millimetre."""
    return replace(
        grasp, T_object_palm=transform(np.eye(3), [1e-4 * i, 0, 0]) @ grasp.T_object_palm
    )


def test_verdicts_are_those_of_the_protocol(
    make: Callable[..., RunningTrials], bar: Part, hand: HandDescription, firm: Grasp, beside: Grasp
) -> None:
    trials = make()
    trials.offer([firm, beside])
    assert trials.with_trials(firm).trials is None
    trials.finish(2, time.monotonic() + 120.0, never)
    good, bad = (trials.with_trials(grasp).trials for grasp in (firm, beside))
    assert good is not None
    assert bad is not None
    cases = finalist_cases(bar, Friction(0.6, 0.6), SETTINGS, seed=0)
    assert [outcome.name for outcome in good.outcomes] == [case.name for case in cases]
    for case, outcome in zip(cases, good.outcomes, strict=True):
        moves = None if case.displacement is None else [case.displacement]
        [alone] = verify(bar, hand, [firm], case.settings, displacements=moves)
        assert outcome.passed == alone.held
        assert outcome.cause == alone.cause
        assert outcome.slip_m == pytest.approx(1e-3 * alone.largest_slip_mm, abs=1e-4)
    assert good.held
    assert not bad.held
    assert len(bad.outcomes) == 1  # what does not hold is not tried further
    assert bad.outcomes[0].cause == "too few touch"
    assert (trials.n_tried, trials.n_lost) == (2, 0)
    [held] = trials.held
    assert held.trials == good


def test_polling_does_not_wait_and_the_verdict_comes(
    make: Callable[..., RunningTrials], firm: Grasp
) -> None:
    trials = make()
    trials.offer([firm])
    limit, longest = time.monotonic() + 120.0, 0.0
    while trials.n_tried == 0 and time.monotonic() < limit:
        start = time.thread_time()
        trials.poll(1)
        longest = max(longest, time.thread_time() - start)
        time.sleep(0.005)
    assert len(trials.held) == 1
    print(f"longest poll {1e3 * longest:.1f} ms of processor time")


def test_without_a_deadline_each_is_tried_once(
    make: Callable[..., RunningTrials], firm: Grasp
) -> None:
    trials = make()
    trials.offer([firm, shifted(firm, 1)])
    trials.finish(1, None, never)
    for grasp in (firm, shifted(firm, 1)):
        known = trials.with_trials(grasp).trials
        assert known is not None
        assert len(known.outcomes) == 1


def test_nothing_is_tried_after_the_deadline_or_a_stop(
    make: Callable[..., RunningTrials], firm: Grasp
) -> None:
    trials = make()
    trials.offer([firm])
    trials.finish(2, time.monotonic() - 1.0, never)
    trials.finish(2, None, lambda: True)
    assert trials.with_trials(firm).trials is None
    trials.offer([])
    trials.finish(2, None, never)
    assert trials.n_tried == 0


def test_what_was_tried_before_is_not_tried_again(
    make: Callable[..., RunningTrials], firm: Grasp
) -> None:
    trials = make()
    known = replace(firm, trials=Trials((TrialOutcome("before", True),)))
    trials.offer([known])
    trials.finish(1, None, never)
    assert trials.with_trials(known).trials is known.trials
    assert trials.n_tried == 0


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV, signal.SIGSTOP])
def test_a_child_that_dies_or_hangs_costs_its_own_trial(
    make: Callable[..., RunningTrials], firm: Grasp, rng: np.random.Generator,
    number: signal.Signals,
) -> None:  # fmt: skip
    """Children are struck at random moments; every grasp is tried, no exception comes up."""
    # A stopped child is known by its limit alone, which a busy machine lets others pass as well.
    hangs = number == signal.SIGSTOP
    limit_s = 1.5 if hangs else SETTINGS.trial_limit_s
    trials = make(replace(SETTINGS, trial_limit_s=limit_s, processes=2, engine="mujoco"))
    n = FAULTS // 2 if hangs else FAULTS
    grasps = [shifted(firm, i) for i in range(n)]
    struck = 0
    for grasp in grasps:
        trials.offer([grasp])
        trials.poll(1)
        time.sleep(float(rng.uniform(0.0, 0.15)))
        for child, _ in list(trials._working.values()):
            os.kill(child.pid, number)
            struck += 1
        trials.finish(1, time.monotonic() + 120.0, lambda: trials.n_tried >= len(grasps))
    assert struck >= n // 2
    assert trials.n_lost > 0
    assert hangs or trials.n_lost <= struck
    assert [trials.with_trials(grasp).trials is not None for grasp in grasps] == [True] * len(
        grasps
    )
    assert len(trials.held) == len(grasps)


def test_a_grasp_that_ends_every_child_is_given_up(
    make: Callable[..., RunningTrials], firm: Grasp, monkeypatch: pytest.MonkeyPatch
) -> None:
    def die(*_: object) -> None:
        os.kill(os.getpid(), signal.SIGKILL)

    monkeypatch.setattr(running_trials.Verifier, "verify", die)
    trials = make()
    trials.offer([firm])
    trials.finish(1, time.monotonic() + 60.0, never)
    assert trials.with_trials(firm).trials is None
    assert trials.n_lost == 3


class Child:
    """A child that answers at once; jobs that are to fail are given by place and case."""

    def __init__(self, failing: set[tuple[int, int]], jobs: list[tuple[int, int]]) -> None:
        self.connection = self
        self._failing, self.jobs = failing, jobs

    def send(self, job: tuple[Grasp, int]) -> None:
        self.jobs.append((round(1e4 * job[0].T_object_palm[0, 3]), job[1]))

    def recv(self) -> tuple[bool, list[Piece]]:
        return self.jobs[-1] not in self._failing, []

    def end(self) -> None:
        pass


class Case:
    """A case whose verdict is its outcome."""

    def outcome(self, passed: bool) -> TrialOutcome:
        return TrialOutcome("case", passed)


def order_of_jobs(
    make: Callable[..., RunningTrials], monkeypatch: pytest.MonkeyPatch, firm: Grasp,
    n_grasps: int, n_cases: int, failing: set[tuple[int, int]],
) -> tuple[list[tuple[int, int]], list[int]]:  # fmt: skip
    """Pairs of grasp and case in the order in which one child gets them; outcomes per grasp."""
    jobs: list[tuple[int, int]] = []
    monkeypatch.setattr(running_trials, "wait", lambda ready, _: ready)
    monkeypatch.setattr(running_trials, "ForkedChild", lambda _: Child(failing, jobs))
    trials = make()
    trials._cases = [Case()] * n_cases
    origin = firm.T_object_palm.copy()
    origin[0, 3] = 0.0
    grasps = [shifted(replace(firm, T_object_palm=origin), i) for i in range(n_grasps)]
    trials.offer(grasps)
    trials.finish(1, time.monotonic() + 60.0, never)
    return jobs, [
        len(known.outcomes) for g in grasps if (known := trials.with_trials(g).trials) is not None
    ]


def test_the_race_and_first_cases_take_turns(
    make: Callable[..., RunningTrials], monkeypatch: pytest.MonkeyPatch, firm: Grasp
) -> None:
    order, made = order_of_jobs(make, monkeypatch, firm, 4, 5, failing={(1, 0)})
    # 0 holds, so that it is ahead; in between 1 fails at once, and 2 and 3 are looked at.
    assert order[:6] == [(0, 0), (1, 0), (0, 1), (2, 0), (0, 2), (3, 0)]
    # What does not hold is not tried further.
    assert made == [5, 1, 5, 5]


def test_a_grasp_that_failed_further_cases_waits(
    make: Callable[..., RunningTrials], monkeypatch: pytest.MonkeyPatch, firm: Grasp
) -> None:
    order, made = order_of_jobs(make, monkeypatch, firm, 3, 6, failing={(0, 1), (0, 2)})
    assert order.index((0, 4)) > order.index((1, 5))
    assert order.index((0, 4)) > order.index((2, 5))
    assert made == [6, 6, 6]


def test_the_parent_has_the_pieces_that_its_children_made(
    make: Callable[..., RunningTrials], firm: Grasp, prepared: PreparedPart
) -> None:
    """What one child made for a grasp, the next child has from the beginning."""
    before = prepared.cover.n_covered
    trials = make()
    trials.offer([firm])
    trials.finish(1, None, never)
    assert trials.n_tried == 1
    assert prepared.cover.n_covered > before or prepared.cover.is_complete()
    assert len(prepared.cover.since(0)) == len(prepared.cover.pieces) > 0


def test_an_idle_child_completes_the_cover(
    make: Callable[..., RunningTrials], bar: Part, firm: Grasp, prepared: PreparedPart,
    tmp_path: Path,
) -> None:  # fmt: skip
    news = tmp_path / "pieces"
    trials = make(on_complete=lambda cover: news.write_text(str(len(cover.pieces))))
    trials.offer([firm])
    trials.finish(1, None, never)
    limit = time.monotonic() + 60.0
    while not (news.exists() and news.read_text()) and time.monotonic() < limit:
        time.sleep(0.01)
    whole = ConvexCover(bar.mesh, prepared.field, prepared.tree)
    whole.add()
    assert int(news.read_text()) >= 1
    assert abs(int(news.read_text()) - len(whole.pieces)) <= 0.3 * len(whole.pieces) + 2


def test_a_child_that_was_begun_covers_the_part_before_there_is_a_grasp(
    make: Callable[..., RunningTrials], firm: Grasp, tmp_path: Path
) -> None:
    news = tmp_path / "pieces"
    trials = make(on_complete=lambda cover: news.write_text(str(len(cover.pieces))))
    trials.begin(1)
    trials.begin(1)  # there is one already
    assert len(trials._idle) == 1
    [child] = trials._idle
    limit = time.monotonic() + 60.0
    while not (news.exists() and news.read_text()) and time.monotonic() < limit:
        time.sleep(0.01)
    assert int(news.read_text()) >= 1
    trials.offer([firm])
    trials.poll(1)
    assert [working for working, _ in trials._working.values()] == [child]
    trials.finish(1, None, never)
    assert trials.with_trials(firm).trials.held


def test_draws_on_another_surface_are_tried_on_that_surface(
    bar: Part, hand: HandDescription, prepared: PreparedPart, firm: Grasp
) -> None:
    """Of two surfaces one is the part's own; on the other there is nothing to hold."""
    away = TriangleMesh(bar.mesh.vertices + np.array([0.5, 0.0, 0.0]), bar.mesh.faces)
    at, settings = bar.mesh.vertices, replace(SETTINGS, draws=2)
    uncertainty = SurfaceUncertainty(at, np.zeros(len(at)), (bar.mesh, away))
    scanned = replace(bar, uncertainty=uncertainty)
    cases = [
        case if case.displacement is None else replace(case, displacement=np.eye(4))
        for case in finalist_cases(scanned, Friction(0.6, 0.6), settings, seed=0)
    ]
    fields = [(DistanceField.of(p.mesh), TriangleTree.of(p.mesh)) for p in scanned.drawn]
    drawn = [
        (part, PreparedPart.of(part, settings, *made))
        for part, made in zip(scanned.drawn, fields, strict=True)
    ]
    trials = RunningTrials(scanned, hand, settings, prepared, cases, drawn)
    try:
        trials.offer([firm])
        trials.finish(1, time.monotonic() + 120.0, never)
        made = trials.with_trials(firm).trials
    finally:
        trials.close()
    assert made is not None
    assert made.outcomes[0].passed
    assert [o.passed for o in made.outcomes if "surface 1" in o.name] == [True]
    assert [o.cause for o in made.outcomes if "surface 2" in o.name] == ["too few touch"]
