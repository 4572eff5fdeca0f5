"""From the search's candidates to grasps that may be answered, each finished once.

A finished grasp has its exact quality, was seen by PyBullet's scene, is clear of the surroundings
and has the pre-grasp it will be answered with. That takes 20 to 100 ms a grasp, so it is done for
the best few while the search goes on, and remembered.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gpis_grasp_planner.grasp.funnel import Funnel, Loss, Step
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.order import answer_rank, distinct
from gpis_grasp_planner.grasp.tally import Tally
from gpis_grasp_planner.plan.case_balance import CaseBalance
from gpis_grasp_planner.plan.placed_grasps import GraspPlacing
from gpis_grasp_planner.search.archive import Candidate
from gpis_grasp_planner.search.context import PlanningContext
from gpis_grasp_planner.search.finalists import grasp_of
from gpis_grasp_planner.surroundings.clearance import Clearance

_SPARE = 1.25
# Where trials will be made, so many times as many candidates are looked at as are finished, as long
# as this share of the time that finishing takes is left.
_POOL = 3
_LOOK_SHARE = 0.8
_LOOKS = 4  # for each candidate that is finished beside a search
_FIRST_COST_S = 0.05
# Of so many of the best one is finished now and then, in a twentieth of the search's time: what one
# costs, 20 to 150 ms by part and by contacts, is known only by the last few.
_SAMPLED = 5
_SAMPLING_PAUSE = 20.0


@dataclass(frozen=True, eq=False)
class FinishedGrasp:
    """A grasp that may be answered, with its distance from the surroundings."""

    grasp: Grasp
    clearance: Clearance


@dataclass(eq=False)
class Finisher:
    """Finishes candidates of one search.

    Attributes
    ----------
    context : PlanningContext
    placing : GraspPlacing
    confirmed : callable
        Whether PyBullet's scene agrees with a grasp.
    clock : callable
        Seconds, steady.
    tally : Tally
        Takes what is lost here; the one of the search's evaluator.
    judge : callable
        Adds what other surfaces of the part say of a grasp.
    exact : callable
        A candidate as it closes on all of the mesh; None if it is no grasp there.
    in_cases : CaseBalance or None
        What the cases of its trials say; None where none will be made.
    cost_s : float [s]
        Longest time for one of the last few candidates.
    n_seen, n_disagreed : int
        Grasps that PyBullet's scene looked at, and did not agree with.
    """

    context: PlanningContext
    placing: GraspPlacing
    confirmed: Callable[[Grasp], bool]
    clock: Callable[[], float]
    tally: Tally
    judge: Callable[[Grasp], Grasp] = lambda grasp: grasp
    in_cases: CaseBalance | None = None
    exact: Callable[[Candidate], Candidate | None] = lambda candidate: candidate
    cost_s: float = _FIRST_COST_S
    n_seen: int = 0
    _added: list[FinishedGrasp] = field(default_factory=list, repr=False)
    _known: dict[bytes, FinishedGrasp | None] = field(default_factory=dict, repr=False)
    _key_of: dict[bytes, bytes] = field(default_factory=dict, repr=False)
    _unseen: dict[bytes, float] = field(default_factory=dict, repr=False)
    _spent_s: deque[float] = field(default_factory=lambda: deque(maxlen=_SAMPLED), repr=False)
    _sample_at: float = -np.inf

    def add(self, finished: Sequence[FinishedGrasp]) -> None:
        """Take grasps of an earlier plan into the competition."""
        self._added.extend(finished)
        self.tally.take_over(len({_palm(f.grasp) for f in finished} - set(self._known)))
        self._known.update({_palm(f.grasp): f for f in finished})

    def best(
        self,
        n: int,
        until: float | None = None,
        fresh: int | None = None,
        *,
        seen: bool = True,
        meanwhile: Callable[[], None] = lambda: None,
    ) -> list[Grasp]:
        """The best finished grasps among the archive's best distinct candidates.

        Parameters
        ----------
        n : int
            At most. A quarter more is finished, since the search's epsilon is an upper bound.
        until : float, optional
            By the clock; no candidate is begun that will not be ready by then, but the first.
        fresh : int, optional
            At most so many are finished in this call; the others wait for the next one.
        seen : bool
            False: those finished now are not shown to PyBullet's scene before :meth:`see`.
        meanwhile : callable
            Called before each candidate that is finished now.

        Returns
        -------
        list of Grasp
            By the objective of their exact figures.
        """
        if seen:
            self.see()
        done = [finished.grasp for finished in self._added]
        # Beside a search the first one is not kept waiting.
        looks = None if fresh is None else _LOOKS * fresh * bool(self._known)
        for candidate in self._chosen(int(np.ceil(_SPARE * n)), until, looks):
            key = _key(candidate)
            if key not in self._known:
                late = until is not None and done and self.clock() + self.cost_s > until
                if late or fresh == 0:
                    continue
                fresh = None if fresh is None else fresh - 1
                meanwhile()
                self._finish(key, candidate, seen)
            finished = self._known[key]
            if finished is not None:
                done.append(finished.grasp)
        done.sort(key=lambda grasp: answer_rank(grasp, self.context.objective))
        if not self._added:
            return done[:n]  # the archive's best are distinct
        T = np.stack([grasp.T_object_palm for grasp in done])
        chosen = distinct(T, np.arange(len(done)), self.context.max_radius, n)
        return [done[i] for i in chosen]

    def see(self) -> None:
        """Show PyBullet's scene what it has not seen; what it does not agree with is dropped."""
        for key, spent_s in self._unseen.items():
            start = self.clock()
            self._look(key)
            self._learn(spent_s + self.clock() - start)
        self._unseen.clear()

    def finished(self) -> list[Grasp]:
        """All grasps that were finished and seen so far, in no order."""
        return [
            known.grasp
            for key, known in self._known.items()
            if known is not None and key not in self._unseen
        ]

    def stands(self, grasp: Grasp) -> bool:
        """Whether a grasp is among those of :meth:`finished`."""
        key = self._known_by(grasp)
        return self._known.get(key) is not None and key not in self._unseen

    def learn_cost(self) -> None:
        """Finish one of the best candidates, if it is time to: the time to keep is known by it.

        Without it a search whose grasps are not tried keeps too little time for a mesh on which
        finishing is slow, and answers fewer grasps than it has.
        """
        start = self.clock()
        if start < self._sample_at:
            return
        self.best(_SAMPLED, fresh=1)
        now = self.clock()
        self._sample_at = now + _SAMPLING_PAUSE * (now - start)

    def time_for(self, n: int) -> float:
        """What it will take to finish the `n` that :meth:`best` would choose now [s]."""
        chosen = self._chosen(int(np.ceil(_SPARE * n)), None, looks=0)
        missing = sum(_key(candidate) not in self._known for candidate in chosen)
        return missing * self.cost_s

    def clearance_of(self, grasp: Grasp) -> Clearance:
        """Of a grasp from :meth:`best`, whatever was added to it since."""
        finished = self._known[self._known_by(grasp)]
        if finished is None:
            raise KeyError("The grasp was not finished here.")
        return finished.clearance

    @property
    def n_disagreed(self) -> int:
        """Grasps that PyBullet's scene did not agree with."""
        return self.tally.lost[Step.CONFIRMED, Loss.SCENE]

    def funnel(self, tried: Sequence[Grasp] | None) -> Funnel:
        """Where grasps were lost, from the first proposal on.

        Parameters
        ----------
        tried : sequence of Grasp, optional
            What is left of :meth:`finished` by the distance rule, with the trials that were made;
            None where none were asked for.
        """
        so_far = self.tally.copy()
        clear = self.tally.funnel(Step.CONFIRMED).left(Step.CLEAR)
        n_looked_at = len(self._known)
        n_distinct = max(n_looked_at, len(self.context.archive.best(clear)))
        so_far.lose(Step.DISTINCT, Loss.NEAR, max(clear - n_distinct, 0))
        so_far.lose(Step.DISTINCT, Loss.BEYOND, min(n_distinct, clear) - n_looked_at)
        if tried is None:
            return so_far.funnel(Step.CONFIRMED)
        so_far.lose(Step.TRIED, Loss.NEAR, len(self.finished()) - len(tried))
        so_far.lose(Step.TRIED, Loss.NO_TIME, sum(grasp.trials is None for grasp in tried))
        for grasp in tried:
            if grasp.trials is not None and not grasp.trials.held:
                so_far.lose(Step.HELD, grasp.trials.outcomes[0].cause)
        return so_far.funnel(Step.HELD)

    def _chosen(self, n: int, until: float | None, looks: int | None) -> list[Candidate]:
        """Which of the archive's distinct candidates to finish.

        The best half by the objective; and, where trials will decide, of the next ones those whose
        objective the trials' cases leave most of. At most `looks` are looked at for that now.
        """
        cases, archive = self.in_cases, self.context.archive
        if cases is None:
            return archive.best(n)
        pool = archive.best(_POOL * n)
        first = (n + 1) // 2
        worth: dict[bytes, float] = {}
        for candidate in pool[first:]:
            if not cases.knows(candidate):
                late = until is not None and self.clock() + _LOOK_SHARE * n * self.cost_s > until
                if late or looks == 0:
                    continue
                looks = None if looks is None else looks - 1
            worth[_key(candidate)] = candidate.objective * cases.of_candidate(candidate)
        others = sorted(pool[first:], key=lambda c: -worth.get(_key(c), 0.0))
        return pool[:first] + others[: n - first]

    def _finish(self, key: bytes, candidate: Candidate, seen: bool) -> None:
        start = self.clock()
        self._known[key] = self._placed(candidate)
        if seen:
            self._look(key)
            self._learn(self.clock() - start)
        else:
            self._unseen[key] = self.clock() - start

    def _look(self, key: bytes) -> None:
        """PyBullet's look at what was placed."""
        placed = self._known[key]
        if placed is None:
            return
        self.n_seen += 1
        if not self.confirmed(placed.grasp):
            self.tally.lose_at(Step.CONFIRMED, Loss.SCENE, placed.grasp.T_object_palm[None])
            self._known[key] = None

    def _known_by(self, grasp: Grasp) -> bytes:
        """The key of a grasp: the palm that its candidate had."""
        palm = _palm(grasp)
        return self._key_of.get(palm, palm)

    def _learn(self, spent_s: float) -> None:
        self._spent_s.append(spent_s)
        self.cost_s = max(self._spent_s)  # time that is left is searched on

    def _placed(self, candidate: Candidate) -> FinishedGrasp | None:
        exact = self.exact(candidate)
        grasp = None if exact is None else grasp_of(exact, self.context)
        if grasp is None or not grasp.feasible:
            self.tally.lose_at(Step.CONFIRMED, Loss.INEXACT, candidate.T_object_palm[None])
            return None
        self._key_of[_palm(grasp)] = _key(candidate)
        [grasp], [clearance] = self.placing.clear([grasp])
        if not clearance.clear:
            self.tally.lose_at(Step.CONFIRMED, Loss.MARGIN, grasp.T_object_palm[None])
            return None
        [grasp], [clearance] = self.placing.finished([grasp], [clearance])
        if not clearance.clear:
            self.tally.lose_at(Step.CONFIRMED, Loss.WAY_BACK, grasp.T_object_palm[None])
            return None
        grasp = self.judge(grasp)
        if self.in_cases is not None:
            grasp = self.in_cases.judged(grasp)
        return FinishedGrasp(grasp, clearance)


def _key(candidate: Candidate) -> bytes:
    return candidate.T_object_palm.tobytes()


def _palm(grasp: Grasp) -> bytes:
    return grasp.T_object_palm.tobytes()
