"""Grasps tried in physics beside the search, in forked children, best first.

The search offers its best grasps again and again; whichever child is free takes the next trial of
their race (`verification.race`), so that the time that there is goes to grasps that may become the
answer. Of each grasp the deciding case comes first; one that fails it is out. A child that dies or
hangs costs its own trial and no more.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing.connection import Connection, wait
from typing import Any

from gpis_grasp_planner.forked_child import ForkedChild, usable_cores
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.trials import TrialOutcome, Trials
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.verification.cases import TrialCase
from gpis_grasp_planner.verification.convex_cover import ConvexCover
from gpis_grasp_planner.verification.engines import load
from gpis_grasp_planner.verification.hold_model import HoldModel
from gpis_grasp_planner.verification.protocol import PreparedPart, Verifier
from gpis_grasp_planner.verification.race import Arm, next_arm
from gpis_grasp_planner.verification.result import Verification
from gpis_grasp_planner.verification.settings import VerificationSettings

_POLL_S = 0.02
_MOST_LOST = 3


@dataclass(eq=False)
class _Tried:
    """One grasp and what came of it so far; `lost` counts trials whose child ended."""

    grasp: Grasp
    outcomes: list[TrialOutcome] = field(default_factory=list)
    running: bool = False
    lost: int = 0


@dataclass(eq=False)
class _Job:
    tried: _Tried
    case: int
    began: float


class RunningTrials:
    """Tries offered grasps of one part until it is closed.

    Children are forked as they are needed; what is to be known in them (the prepared part, compiled
    code) must be there before the first :meth:`offer`.

    Parameters
    ----------
    part : Part
    hand : HandDescription
    settings : VerificationSettings
    prepared : PreparedPart
    cases : sequence of TrialCase
        The first decides whether a grasp holds; what fails it is not tried further.
    drawn : sequence of (Part, PreparedPart)
        Of `Part.drawn`, where cases are made on them.
    on_complete : callable, optional
        Called in the child that has covered the whole part while it had nothing to try.
    clock : callable
        Seconds, steady.

    Attributes
    ----------
    n_lost : int
        Trials whose child died or had to be ended.
    model : HoldModel
        Has learnt from all trials so far.
    """

    def __init__(
        self,
        part: Part,
        hand: HandDescription,
        settings: VerificationSettings,
        prepared: PreparedPart,
        cases: Sequence[TrialCase],
        drawn: Sequence[tuple[Part, PreparedPart]] = (),
        on_complete: Callable[[ConvexCover], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ):
        self._settings, self._cases, self._clock = settings, cases, clock
        for engine in dict.fromkeys(case.settings.engine for case in cases):
            load(engine, hand)  # here, so that no child needs to
        self._cover = prepared.cover
        self._serve = partial(_serve, ((part, prepared), *drawn), hand, cases, on_complete)
        self._tried: dict[bytes, _Tried] = {}
        self._offered: list[_Tried] = []
        self._idle: list[ForkedChild] = []
        self._working: dict[Any, tuple[ForkedChild, _Job]] = {}
        self.n_lost = 0
        self.model = HoldModel()
        self._turn = 0
        self._held: list[Grasp] | None = None  # until the next verdict

    @property
    def n_tried(self) -> int:
        """Grasps whose deciding case was made."""
        return sum(bool(tried.outcomes) for tried in self._tried.values())

    @property
    def held(self) -> list[Grasp]:
        """Those of them that held, with their trials so far."""
        if self._held is None:  # asked for at every step of a search
            self._held = [
                self.with_trials(tried.grasp)
                for tried in self._tried.values()
                if tried.outcomes and tried.outcomes[0].passed
            ]
        return self._held

    def begin(self, processes: int) -> None:
        """Fork the children before there is a grasp: the engine's world takes 0.1 s to make."""
        while len(self._idle) + len(self._working) < processes:
            self._idle.append(ForkedChild(self._serve))

    def offer(self, grasps: Sequence[Grasp]) -> None:
        """Replace the list of grasps that wait, best first. Trials that run are not ended."""
        self._offered = [self._tried.setdefault(_key(g), _Tried(g)) for g in grasps]

    def with_trials(self, grasp: Grasp) -> Grasp:
        """The grasp with what is known of it: its trials, if any were made, and its estimate."""
        trials, tried = grasp.trials, self._tried.get(_key(grasp))
        if trials is None and tried is not None and tried.outcomes:
            trials = Trials(tuple(tried.outcomes))
        grasp = replace(grasp, trials=trials)
        return replace(grasp, hold_estimate=self.model.estimate(grasp))

    def poll(self, processes: int, wait_s: float = 0.0) -> None:
        """Take verdicts that are ready and give work to idle children.

        Parameters
        ----------
        processes : int
            Children that may work at a time.
        wait_s : float [s]
            Wait so long for a verdict, if any is expected.
        """
        self._give_work(processes)
        if not self._working:
            return
        for ready in wait(list(self._working), wait_s):
            self._take(ready)
        self._end_late_ones()
        self._give_work(processes)

    def finish(
        self, processes: int, deadline: float | None, should_stop: Callable[[], bool]
    ) -> None:
        """Go on until all that was offered is tried in all cases, or the deadline.

        Parameters
        ----------
        processes : int
        deadline : float or None
            By the clock. A trial that is not finished then does not count. None: only the
            deciding case of each is made.
        should_stop : callable
            Asked some fifty times a second.
        """
        cases = self._cases
        if deadline is None:
            self._cases = cases[:1]
        try:
            while not should_stop() and (deadline is None or self._clock() < deadline):
                self.poll(processes, _POLL_S)
                if not self._working:
                    break
        finally:
            self._cases = cases

    def close(self) -> None:
        """End the children. Idempotent."""
        for child in [*self._idle, *(child for child, _ in self._working.values())]:
            child.end()
        self._idle, self._working = [], {}

    def _give_work(self, processes: int) -> None:
        while len(self._working) < processes and (job := self._next()) is not None:
            child = self._idle.pop() if self._idle else ForkedChild(self._serve)
            job.tried.running = True
            self._working[child.connection] = child, job
            with suppress(OSError):  # of a child that is gone, reading tells
                child.connection.send((job.tried.grasp, job.case))

    def _next(self) -> _Job | None:
        """The trial whose turn it is among those that were offered and wait."""
        if not any(self._n_left(t) and not t.running for t in self._offered):
            return None
        chosen = next_arm([self._arm(tried) for tried in self._offered], self._turn)
        if chosen is None:
            return None
        self._turn += 1
        tried = self._offered[chosen]
        return _Job(tried, len(tried.outcomes), self._clock())

    def _n_left(self, tried: _Tried) -> int:
        """Cases left; none once the deciding one failed, or the trials of the grasp are lost."""
        failed = bool(tried.outcomes) and not tried.outcomes[0].passed
        if failed or tried.lost >= _MOST_LOST or tried.grasp.trials is not None:
            return 0
        return len(self._cases) - len(tried.outcomes)

    def _arm(self, tried: _Tried) -> Arm:
        posterior = self.model.posterior(tried.grasp, tried.outcomes)
        return Arm(posterior, len(tried.outcomes), self._n_left(tried), tried.running)

    def _take(self, ready: Any) -> None:
        child, job = self._working.pop(ready)
        job.tried.running = False
        try:
            verdict, pieces = child.connection.recv()
        except (EOFError, OSError):
            self._lose(child, job)
            return
        self._cover.take(pieces)  # later children and plans need not make them again
        job.tried.outcomes.append(self._cases[job.case].outcome(verdict))
        self.model.learn(job.tried.grasp, job.tried.outcomes)
        self._held = None
        self._idle.append(child)

    def _end_late_ones(self) -> None:
        limit = self._clock() - self._settings.trial_limit_s
        for connection, (child, job) in list(self._working.items()):
            if job.began < limit:
                del self._working[connection]
                job.tried.running = False
                self._lose(child, job)

    def _lose(self, child: ForkedChild, job: _Job) -> None:
        """The child is no more; its grasp may be tried again, but not for ever."""
        child.end()
        job.tried.lost += 1
        self.n_lost += 1


def processes_beside_a_search(settings: VerificationSettings) -> int:
    """Children to run while the search has a core of its own; one on a single core."""
    return max(1, min(settings.processes, usable_cores() - 1))


def processes_alone(settings: VerificationSettings) -> int:
    """Children to run when nothing else does."""
    return max(1, min(settings.processes, usable_cores()))


def _key(grasp: Grasp) -> bytes:
    return grasp.T_object_palm.tobytes() + grasp.pregrasp_joints.tobytes()


def _serve(
    parts: Sequence[tuple[Part, PreparedPart]],
    hand: HandDescription,
    cases: Sequence[TrialCase],
    on_complete: Callable[[ConvexCover], None] | None,
    connection: Connection,
) -> None:
    prepared = parts[0][1]
    with ExitStack() as owned:
        # By engine and surface; all but the first only if they are asked for.
        verifiers: dict[tuple[str, int], Verifier] = {}

        def verifier_for(case: TrialCase) -> Verifier:
            key = case.settings.engine, 0 if case.surface is None else 1 + case.surface
            if key not in verifiers:
                part, made = parts[key[1]]
                verifiers[key] = owned.enter_context(Verifier(part, hand, case.settings, made))
            return verifiers[key]

        def answer(job: tuple[Grasp, int]) -> Verification:
            grasp, case = job[0], cases[job[1]]
            verifier = verifier_for(case)
            verifier.use(case.settings)
            if case.displacement is None:
                return verifier.verify(grasp)
            return verifier.verify_displaced(grasp, case.displacement)

        verifier_for(cases[0])  # while there is nothing to try yet
        told = prepared.cover.is_complete()
        sent = len(prepared.cover.pieces)
        while True:
            # With nothing to try the rest of the cover is made, for later grasps and plans.
            while not connection.poll(0.0) and not prepared.cover.is_complete():
                prepared.cover.add(go_on=lambda: not connection.poll(0.0))
            if prepared.cover.is_complete() and not told and on_complete is not None:
                on_complete(prepared.cover)
                told = True
            verdict = answer(connection.recv())
            connection.send((verdict, prepared.cover.since(sent)))
            sent = len(prepared.cover.pieces)
