"""Grasps of one part, tried in physics by forked children while the search goes on.

Trials are made best grasp first, and of each grasp the deciding one first; how a grasp does in
the further cases is found out while lower grasps still wait for their first, so that the time that
there is goes to grasps that may become the answer. The search offers its best grasps again and
again: what was tried is remembered, what was not yet begun makes room. A child that dies or hangs
costs the trial that it made.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from multiprocessing.connection import wait
from typing import Any

from gpis_grasp_planner.forked_child import ForkedChild, answer_requests, usable_cores
from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.trials import TrialOutcome, Trials
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.verification.bullet.bodies import link_hulls
from gpis_grasp_planner.verification.cases import TrialCase
from gpis_grasp_planner.verification.protocol import (
    PreparedPart,
    Verifier,
    known,
    prepare,
    remember,
)
from gpis_grasp_planner.verification.result import Verification
from gpis_grasp_planner.verification.settings import VerificationSettings

# A grasp's next case comes as late as the first case of the grasp so many places below it; each
# case that it failed puts it further back.
_PLACES_PER_CASE = 4
_PLACES_PER_FAILURE = 8
_POLL_S = 0.05


@dataclass(eq=False)
class _Record:
    """What is known of one grasp: outcomes by case, whether a child has it, why one was lost."""

    grasp: Grasp
    outcomes: list[TrialOutcome] = field(default_factory=list)
    running: bool = False
    lost: str = ""

    def open_for(self, n_cases: int) -> bool:
        """Whether it may be tried in a further case."""
        n = len(self.outcomes)
        passed = n == 0 or self.outcomes[0].passed
        return not (self.running or self.lost) and passed and n < n_cases

    def weight(self, place: int) -> int:
        """How late its next trial comes, at a place of the ranking."""
        failures = sum(not outcome.passed for outcome in self.outcomes)
        return place + _PLACES_PER_CASE * len(self.outcomes) + _PLACES_PER_FAILURE * failures


@dataclass(eq=False)
class _Worker:
    """A child and the trial that it makes now."""

    child: ForkedChild
    record: _Record | None = None
    case: TrialCase | None = None
    since: float = 0.0


class FinalistTrials:
    """Tries the grasps of one part; the part is covered by convex pieces in the background.

    Parameters
    ----------
    part : Part
    hand : HandDescription
    settings : VerificationSettings
    field, tree : DistanceField, TriangleTree
        Of the part.
    """

    def __init__(
        self,
        part: Part,
        hand: HandDescription,
        settings: VerificationSettings,
        field: DistanceField,
        tree: TriangleTree,
    ):
        self.part, self.hand, self.settings = part, hand, settings
        self._field, self._tree = field, tree
        self._records: dict[bytes, _Record] = {}
        self._offered: list[_Record] = []
        self._cases: list[TrialCase] = []
        self._n_cases = 0
        self._workers: list[_Worker] = []
        self._spent_s, self._n_made = 0.0, 0
        self._no_cover = ""
        link_hulls(hand)  # 0.2 s, here once, so that no child needs to
        self._prepared = known(part, settings)
        self._cover: ForkedChild | None = None
        if self._prepared is None:
            self._cover = ForkedChild(self._send_cover)

    def close(self) -> None:
        """End what still runs in the background. Idempotent."""
        if self._cover is not None:
            self._cover.end()
            self._cover = None
        while self._workers:
            self._end(self._workers[-1])

    def offer(self, grasps: Sequence[Grasp], cases: Sequence[TrialCase]) -> None:
        """Try these grasps, best first, in place of those offered before and not yet begun.

        Returns at once; :meth:`poll` gives the children their work.
        """
        if any(a is not b for a, b in zip(self._cases, cases, strict=False)):
            self._records.clear()
            self._cases = []
        if len(cases) > len(self._cases):
            self._cases = list(cases)
        self._n_cases = len(cases)
        self._offered = [self._records.setdefault(place_of(g), _Record(g)) for g in grasps]

    def poll(self, processes: int | None = None, timeout_s: float = 0.0) -> int:
        """Take what the children have found and give them their next trials.

        Parameters
        ----------
        processes : int, optional
            Children at a time; as the settings say and as there are cores if not given.
        timeout_s : float [s]
            How long to wait for a verdict; 0 does not wait.

        Returns
        -------
        int
            How many trials have come to an end.
        """
        if self._wait_for_cover(timeout_s) is None:
            return 0
        n = min(processes or self.settings.processes, usable_cores())
        self._give_work(n)
        busy = [worker for worker in self._workers if worker.record is not None]
        ready = wait([worker.child.connection for worker in busy], timeout_s) if busy else []
        ended = 0
        for worker in busy:
            if worker.child.connection in ready:
                self._take(worker)
            elif time.monotonic() - worker.since > self.settings.trial_limit_s:
                self._lose(worker, f"took more than {self.settings.trial_limit_s:g} s")
            else:
                continue
            ended += 1
        if ended:
            self._give_work(n)
        return ended

    @property
    def busy(self) -> bool:
        """Whether a trial is being made or waits."""
        waiting = any(record.open_for(self._n_cases) for record in self._offered)
        return waiting or any(worker.record is not None for worker in self._workers)

    @property
    def hungry(self) -> bool:
        """Whether fewer grasps wait for their first trial than there are children."""
        first = [r for r in self._offered if not r.outcomes and r.open_for(self._n_cases)]
        return len(first) < max(1, len(self._workers))

    @property
    def held(self) -> list[Grasp]:
        """Grasps that passed their first trial, whether they are still offered or not."""
        return [r.grasp for r in self._records.values() if r.outcomes and r.outcomes[0].passed]

    @property
    def n_tried(self) -> int:
        """How many grasps have a verdict."""
        return sum(bool(record.outcomes) for record in self._records.values())

    @property
    def why_untried(self) -> str:
        """Why grasps have no verdict: trials that were lost, or a cover that is not there."""
        lost = sorted({record.lost for record in self._records.values() if record.lost})
        if self._prepared is None:
            lost.append(self._no_cover or "the part's convex cover was not ready")
        return "; ".join(lost)

    def time_for(self, grasps: Sequence[Grasp], further: int = 0) -> float | None:
        """What the first trials of those without one will take [s]; None if none was made yet.

        `further` grasps are counted beside them.
        """
        if not self._n_made:
            return None
        records = [self._records.get(place_of(grasp)) for grasp in grasps]
        n = further + sum(r is None or (not r.outcomes and not r.lost) for r in records)
        processes = max(1, min(self.settings.processes, usable_cores()))
        return n * self._spent_s / self._n_made / processes

    def run(
        self,
        grasps: Sequence[Grasp],
        cases: Sequence[TrialCase],
        deadline: float | None,
        should_stop: Callable[[], bool] | None = None,
    ) -> list[Trials | None]:
        """Try grasps, best first, in as many cases as the time allows.

        A grasp that fails the first case is not tried in the others; what was tried before is not
        tried again.

        Parameters
        ----------
        grasps : sequence of Grasp
        cases : sequence of TrialCase
        deadline : float or None
            Time of ``time.monotonic``. A trial that is not finished then does not count.
        should_stop : callable, optional
            Asked some 20 times a second; True ends the trials as the deadline does.

        Returns
        -------
        list of (Trials or None)
            In the order of the grasps; None where not even the first case was finished.
        """

        def over() -> bool:
            late = deadline is not None and time.monotonic() >= deadline
            return late or (should_stop is not None and should_stop())

        self.offer(grasps, cases)
        offered = list(self._offered)
        while self.busy and not over() and not self._no_cover:
            self.poll(timeout_s=_POLL_S)
        for worker in [w for w in self._workers if w.record is not None]:
            self._end(worker)  # what is not finished does not count
        return [Trials(tuple(r.outcomes)) if r.outcomes else None for r in offered]

    def _give_work(self, processes: int) -> None:
        while True:
            order = sorted(
                (record.weight(place), place)
                for place, record in enumerate(self._offered)
                if record.open_for(self._n_cases)
            )
            idle = [worker for worker in self._workers if worker.record is None]
            n_busy = len(self._workers) - len(idle)
            if not order or n_busy >= processes:
                return
            record = self._offered[order[0][1]]
            case = self._cases[len(record.outcomes)]
            try:
                worker = idle[0] if idle else self._new_worker()
            except OSError as error:
                record.lost = f"no child process could be started ({error.strerror})"
                continue
            worker.record, worker.case, worker.since = record, case, time.monotonic()
            record.running = True
            try:
                worker.child.connection.send((record.grasp, case))
            except OSError:
                self._lose(worker, _ended(worker.child))

    def _new_worker(self) -> _Worker:
        assert self._prepared is not None
        serve = partial(_serve, self.part, self.hand, self.settings, self._prepared)
        worker = _Worker(ForkedChild(serve))
        self._workers.append(worker)
        return worker

    def _take(self, worker: _Worker) -> None:
        record, case = worker.record, worker.case
        assert record is not None
        assert case is not None
        try:
            verdict: Verification | Exception = worker.child.connection.recv()
        except (EOFError, OSError):
            self._lose(worker, _ended(worker.child))
            return
        if isinstance(verdict, Exception):
            raise verdict
        worker.record, record.running = None, False
        record.outcomes.append(case.outcome(verdict))
        self._spent_s += time.monotonic() - worker.since
        self._n_made += 1

    def _lose(self, worker: _Worker, why: str) -> None:
        """Give up a child and the trial that it made: its grasp is not tried again."""
        if worker.record is not None:
            worker.record.lost = f"a trial's process {why}"
        self._end(worker)

    def _end(self, worker: _Worker) -> None:
        if worker.record is not None:
            worker.record.running = False
        worker.child.end()
        self._workers.remove(worker)

    def _send_cover(self, connection: Any) -> None:
        connection.send(prepare(self.part, self.settings, self._field, self._tree).pieces)

    def _wait_for_cover(self, timeout_s: float) -> PreparedPart | None:
        """The prepared part, or None if it is not ready in time or its child was lost."""
        if self._prepared is None and self._cover is not None:
            if not self._cover.connection.poll(timeout_s):
                return None
            try:
                pieces = self._cover.connection.recv()
            except (EOFError, OSError):
                self._no_cover = f"the process that covers the part {_ended(self._cover)}"
                self._cover.end()
                self._cover = None
                return None
            self._prepared = PreparedPart(self._field, self._tree, pieces)
            remember(self.part, self.settings, self._prepared)
        return self._prepared


def place_of(grasp: Grasp) -> bytes:
    """What tells grasps of one search apart."""
    return grasp.T_object_palm.tobytes() + grasp.pregrasp_joints.tobytes()


def trial_notes(
    part: Part, settings: VerificationSettings, trials: FinalistTrials
) -> tuple[str, ...]:
    """What an answer says of its trials beside their number: grasps untried, a part too heavy."""
    notes: tuple[str, ...] = ()
    if trials.why_untried:
        notes += (f"Grasps that were not tried in physics: {trials.why_untried}.",)
    if part.mass > settings.payload_kg:
        notes += (
            f"'{part.mesh_id}' weighs {part.mass:.3g} kg, more than the payload of "
            f"{settings.payload_kg:g} kg: its trials were made with {settings.mass_kg:g} kg, and "
            "what held there need not hold the part. Set the density if it is lighter.",
        )
    return notes


def _ended(child: ForkedChild) -> str:
    """How a child went, for a sentence of which it is the subject."""
    code = child.exit_code()
    return f"was ended by signal {-code}" if code is not None and code < 0 else "ended early"


def _serve(
    part: Part,
    hand: HandDescription,
    settings: VerificationSettings,
    prepared: PreparedPart,
    connection: Any,
) -> None:
    with Verifier(part, hand, settings, prepared) as verifier:

        def answer(job: tuple[Grasp, TrialCase]) -> Verification | Exception:
            grasp, case = job
            try:
                verifier.use(case.settings)
                if case.displacement is None:
                    return verifier.verify(grasp)
                return verifier.verify_displaced(grasp, case.displacement)
            except Exception as error:
                return error  # the parent raises it

        answer_requests(answer, connection)
