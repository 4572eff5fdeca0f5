"""The planner's finalists, tried in physics side by side, until the deadline.

Trials are made best grasp first, and of each grasp the deciding one first; how a grasp does in
the further cases is found out while lower grasps still wait for their first, so that the time that
there is goes to grasps that may become the answer.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Sequence
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
        self._prepared = known(part, settings)
        self._cover: ForkedChild | None = None
        if self._prepared is None:
            self._cover = ForkedChild(self._send_cover)

    def close(self) -> None:
        """End what still runs in the background. Idempotent."""
        if self._cover is not None:
            self._cover.end()
            self._cover = None

    def run(
        self,
        grasps: Sequence[Grasp],
        cases: Sequence[TrialCase],
        deadline: float | None,
        should_stop: Callable[[], bool] | None = None,
    ) -> list[Trials | None]:
        """Try grasps, best first, in as many cases as the time allows.

        A grasp that fails the first case is not tried in the others.

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

        outcomes: list[list[TrialOutcome]] = [[] for _ in grasps]
        prepared = self._wait_for_cover(over) if len(grasps) else None
        if prepared is not None:
            n = max(1, min(self.settings.processes, usable_cores(), len(grasps)))
            link_hulls(self.hand)  # here, so that no child needs to
            serve = partial(_serve, self.part, self.hand, prepared, grasps, cases)
            children = [ForkedChild(serve) for _ in range(n)]
            try:
                _share_out(children, len(grasps), cases, outcomes, over)
            finally:
                for child in children:
                    child.end()
        return [Trials(tuple(of_grasp)) if of_grasp else None for of_grasp in outcomes]

    def _send_cover(self, connection: Any) -> None:
        connection.send(prepare(self.part, self.settings, self._field, self._tree).pieces)

    def _wait_for_cover(self, over: Callable[[], bool]) -> PreparedPart | None:
        """The prepared part, or None if it is not ready in time."""
        while self._prepared is None and self._cover is not None and not over():
            if self._cover.connection.poll(_POLL_S):
                try:
                    pieces = self._cover.connection.recv()
                except EOFError:  # the child failed: here the error shows
                    self._prepared = prepare(self.part, self.settings, self._field, self._tree)
                    break
                self._prepared = PreparedPart(self._field, self._tree, pieces)
                remember(self.part, self.settings, self._prepared)
        return self._prepared


def _share_out(
    children: Sequence[ForkedChild],
    n_grasps: int,
    cases: Sequence[TrialCase],
    outcomes: list[list[TrialOutcome]],
    over: Callable[[], bool],
) -> None:
    """Give the children (grasp, case) pairs by their weight; `outcomes` is filled."""
    waiting = [(i, i, 0) for i in range(n_grasps)]  # a heap: weight, grasp, case
    idle = list(children)
    working: dict[Any, tuple[ForkedChild, int, int]] = {}
    while (waiting or working) and not over():
        while idle and waiting:
            _, grasp, case = heapq.heappop(waiting)
            child = idle.pop()
            child.connection.send((grasp, case))
            working[child.connection] = (child, grasp, case)
        for ready in wait(list(working), _POLL_S):
            child, grasp, case = working.pop(ready)
            verdict: Verification = child.connection.recv()
            outcomes[grasp].append(cases[case].outcome(verdict))
            idle.append(child)
            if outcomes[grasp][0].passed and case + 1 < len(cases):
                failures = sum(not outcome.passed for outcome in outcomes[grasp])
                weight = grasp + _PLACES_PER_CASE * (case + 1) + _PLACES_PER_FAILURE * failures
                heapq.heappush(waiting, (weight, grasp, case + 1))


def _serve(
    part: Part,
    hand: HandDescription,
    prepared: PreparedPart,
    grasps: Sequence[Grasp],
    cases: Sequence[TrialCase],
    connection: Any,
) -> None:
    with Verifier(part, hand, cases[0].settings, prepared) as verifier:

        def answer(job: tuple[int, int]) -> Verification:
            grasp, case = grasps[job[0]], cases[job[1]]
            verifier.use(case.settings)
            if case.displacement is None:
                return verifier.verify(grasp)
            return verifier.verify_displaced(grasp, case.displacement)

        answer_requests(answer, connection)
