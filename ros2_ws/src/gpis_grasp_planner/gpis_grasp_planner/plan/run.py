"""One search for one part at one place, from a prepared object to a ranked, tried answer."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from types import TracebackType
from typing import Self

import numpy as np

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.funnel import Funnel
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.order import answer_rank
from gpis_grasp_planner.plan.answer import Answer, found_text, nothing_found, nothing_holds
from gpis_grasp_planner.plan.case_balance import CaseBalance
from gpis_grasp_planner.plan.confirming_scene import ConfirmingScene
from gpis_grasp_planner.plan.constraints import make_constraints
from gpis_grasp_planner.plan.finisher import FinishedGrasp, Finisher
from gpis_grasp_planner.plan.hand_limits import HandLimit, limit_of
from gpis_grasp_planner.plan.hold_ranking import HoldRanking
from gpis_grasp_planner.plan.kept_cover import KeptCover
from gpis_grasp_planner.plan.objective import make_objective, reported_measures
from gpis_grasp_planner.plan.placed_grasps import GraspPlacing
from gpis_grasp_planner.plan.preparation import PreparedObject
from gpis_grasp_planner.plan.progress import Monitor, Phase
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.result import make_result
from gpis_grasp_planner.plan.search_evaluator import search_evaluator
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.plan.tried_grasps import TriedGrasps, payload_note
from gpis_grasp_planner.search.archive import GraspArchive
from gpis_grasp_planner.search.context import PlanningContext
from gpis_grasp_planner.search.finalists import RESERVE, choose_reserve, grasp_of
from gpis_grasp_planner.search.searches import make_search
from gpis_grasp_planner.surroundings.place import Place
from gpis_grasp_planner.verification.cases import TrialCase, finalist_cases
from gpis_grasp_planner.verification.protocol import PreparedPart, prepare
from gpis_grasp_planner.verification.running_trials import (
    RunningTrials,
    processes_alone,
    processes_beside_a_search,
)

_SECONDS_AFTER_CANCEL = 0.2
# For the reserve and the ranking, once nothing is searched or tried any more.
_SECONDS_TO_ANSWER = 0.15
_ANSWER_SHARE = 0.1
_SHORTEST_ROUND_S = 1.0
_RESERVE_INTERVAL_S = 0.2
_SEARCH_SHARE = 0.5
# Beside the search so many of the best are on offer for trials; a further one is finished after
# an interval, or after so many times what the last one took.
_OFFERED = 8
_OFFER_INTERVAL_S = 0.2
_OFFER_PAUSE = 4.0


class PlanRun:
    """Searches, finishes, tries and ranks; a context manager that ends what it started.

    Parameters
    ----------
    part, settings, prepared
    request, place : PlanRequest, Place
    placing, hold : GraspPlacing, HoldRanking
        Of this place.
    monitor : Monitor
    """

    def __init__(
        self,
        part: Part,
        settings: PlannerSettings,
        prepared: PreparedObject,
        request: PlanRequest,
        place: Place,
        placing: GraspPlacing,
        hold: HoldRanking,
        monitor: Monitor,
    ):
        self.part, self.hand, self.settings = part, placing.hand, settings
        self.request, self.place, self.monitor = request, place, monitor
        self._prepared = prepared
        self._friction = request.friction_for(part.friction)
        self._owned = ExitStack()
        self._constraints = make_constraints(
            self.hand, request, place, settings, placing.arm, placing.own
        )
        self._objective = make_objective(settings, part)
        self._evaluator, self._tally, exact = self._owned.enter_context(
            search_evaluator(
                *(part, self.hand, self._friction, settings, prepared),
                *(self._constraints, self._objective, self._is_over),
            )
        )
        self._archive = GraspArchive(part.max_radius, self._objective)
        self._context = PlanningContext(
            part=part,
            hand=self.hand,
            evaluator=self._evaluator,
            atlas=prepared.atlas,
            archive=self._archive,
            settings=settings.search,
            rng=np.random.default_rng(request.seed),
            constraints=self._constraints,
            reported=reported_measures(settings, part),
        )
        self._search = make_search(request.planner, self._context)
        scene = self._owned.enter_context(
            ConfirmingScene(part, self.hand, self._friction, settings.scene, prepared)
        )
        cases: Sequence[TrialCase] = ()
        if request.verification != "none":
            cases = finalist_cases(
                part, self._friction, settings.verification, request.seed, place.covariance
            )
        self._finisher = Finisher(
            *(self._context, placing, scene.agrees, monitor.now, self._tally),
            hold.on_surfaces.judged,
            CaseBalance(part, self.hand, settings, prepared.for_search, cases) if cases else None,
            exact,
        )
        self._hold = hold
        self._limit: HandLimit | None = None
        self._convergence: list[tuple[float, int, float]] = []
        self._trials = self._make_trials(cases) if cases else None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._owned.close()

    def answer(self, known: Sequence[FinishedGrasp] = ()) -> Answer:
        """Search until the budget asks for the rest, and do the rest.

        What is left of the time after it, where less was needed than was kept or nothing held, is
        searched on.

        Parameters
        ----------
        known : sequence of FinishedGrasp
            Grasps of an earlier plan that are clear here: they compete with those found now.
        """
        monitor, trials = self.monitor, self._trials
        self._finisher.add(known)
        with monitor.phase(Phase.PREPARING):
            self._limit = (
                None
                if known
                else limit_of(
                    self.part, self.hand, self._friction, self.place, self.settings, monitor
                )
            )
        if self._limit is not None:
            return self._answer_of((), None)
        while True:
            self._search_on()
            deadline = None if self.request.max_evaluations else self._deadline
            if monitor.cancelled:
                deadline = monitor.now() + _SECONDS_AFTER_CANCEL
            with monitor.phase(Phase.PLACING):
                until = deadline
                if trials is not None and deadline is not None and not monitor.cancelled:
                    until = deadline - self.settings.verification.budget_share * monitor.left_s
                grasps = tuple(
                    self._finisher.best(self._n_wanted, until, meanwhile=self._keep_trying)
                )
            over = self._search.finished or deadline is None or monitor.cancelled
            if trials is not None and grasps and not monitor.cancelled:
                with monitor.phase(Phase.TRYING):
                    self._finish_trials(trials, grasps, deadline)
                over = over or bool(self._held(trials))
            if over or monitor.left_s < _SHORTEST_ROUND_S:
                break
        return self._answer_of(grasps, deadline)

    @property
    def _deadline(self) -> float:
        """When nothing further is begun, so that the answer itself is still in time."""
        budget = self.monitor.time_budget_s
        return self.monitor.deadline - min(_SECONDS_TO_ANSWER, _ANSWER_SHARE * budget)

    @property
    def _n_wanted(self) -> int:
        """Grasps to finish: more than asked for where their order is not known yet."""
        return self._hold.candidates(self.request.n_grasps)

    def _is_over(self) -> bool:
        """Whether the answer is due, so that not even a begun batch of attempts goes on."""
        limited = self.request.max_evaluations is not None
        return self.monitor.stopped() or (not limited and self.monitor.now() >= self._deadline)

    def _make_trials(self, cases: Sequence[TrialCase]) -> RunningTrials:
        verification, prepared = self.settings.verification, self._prepared
        made = prepare(self.part, verification, prepared.field, prepared.tree)
        tolerance, spacing = verification.cover_tolerance_m, prepared.field.spacing
        kept = KeptCover(self.settings.cache, self.part.working_mesh, tolerance, spacing)
        kept.load_into(made.cover)
        drawn = [
            (part, PreparedPart.of(part, verification, *draw))
            for part, draw in zip(self.part.drawn, prepared.draws, strict=True)
        ]
        trials = RunningTrials(
            self.part, self.hand, verification, made, cases, drawn, kept.save, self.monitor.now
        )
        self._owned.callback(kept.save, made.cover)
        self._owned.callback(trials.close)
        return trials

    def _search_on(self) -> None:
        """Step the search until the rest of the budget is needed for what comes after it.

        It gets at least half of what is left when it begins. One step is always taken: a budget
        that the preparation has used up still tries.
        """
        monitor, limit, archive = self.monitor, self.request.max_evaluations, self._archive
        began = monitor.now()
        left = self._deadline - began
        share = self.settings.verification.budget_share if self._trials is not None else 0.0
        end, looked_at, offer_at, stepped = began, began, began, False
        trials = self._trials if limit is None else None
        if trials is not None:
            trials.begin(processes_beside_a_search(self.settings.verification))
        with monitor.phase(Phase.SEARCHING):
            while not self._search.finished and not monitor.stopped():
                now = monitor.now()
                if now >= looked_at:
                    looked_at = now + _RESERVE_INTERVAL_S
                    if self._trials is None and limit is None:
                        self._finisher.learn_cost()
                    n = self._n_wanted
                    rest = self._finisher.time_for(n) + self._hold.time_for(n)
                    end = began + max(left - share * left - rest, _SEARCH_SHARE * left)
                over = limit is not None and self._evaluator.n_attempts >= limit
                if over or (stepped and now >= end):
                    break
                self._search.step()
                stepped = True
                if trials is not None:
                    offer_at = self._try_beside(trials, offer_at)
                best, attempts = archive.best_epsilon, self._evaluator.n_attempts
                monitor.update(evaluations=attempts, best_epsilon=best, n_candidates=len(archive))
                if best > (self._convergence[-1][2] if self._convergence else 0.0):
                    self._convergence.append((monitor.elapsed_s, attempts, best))

    def _try_beside(self, trials: RunningTrials, offer_at: float) -> float:
        """Keep the trials going while the search goes on; when to finish further grasps.

        Finishing is in the way of the search: it gets a fifth of its time at most.
        """
        monitor = self.monitor
        processes = processes_beside_a_search(self.settings.verification)
        now = monitor.now()
        if now >= offer_at and len(self._archive):
            trials.offer(self._finisher.best(_OFFERED, fresh=1, seen=False))
            trials.poll(processes)  # the first trial runs while PyBullet looks
            self._finisher.see()
            spent = monitor.now() - now
            offer_at = monitor.now() + max(_OFFER_INTERVAL_S, _OFFER_PAUSE * spent)
        trials.poll(processes)
        self._tell_of(trials)
        return offer_at

    def _keep_trying(self) -> None:
        """Keep the trials going while grasps are finished; a count of attempts has none then."""
        if self._trials is not None and self.request.max_evaluations is None:
            self._trials.poll(processes_beside_a_search(self.settings.verification))

    def _finish_trials(
        self, trials: RunningTrials, grasps: Sequence[Grasp], deadline: float | None
    ) -> None:
        """Try the finished grasps, best first, until the deadline leaves only the ranking."""
        if deadline is not None:
            deadline -= self._hold.time_for(self._n_wanted)
        trials.offer(grasps)

        def stopped() -> bool:
            self._tell_of(trials)
            return self.monitor.stopped()

        trials.finish(processes_alone(self.settings.verification), deadline, stopped)
        self._tell_of(trials)

    def _tell_of(self, trials: RunningTrials) -> None:
        """Report how many grasps were tried, and the best of those that held."""
        held, objective = self._held(trials), self._objective
        best = min(held, key=lambda grasp: answer_rank(grasp, objective)) if held else None
        self.monitor.update(n_tried=trials.n_tried, n_held=len(held), best_held=best)

    def _held(self, trials: RunningTrials) -> list[Grasp]:
        """Grasps that held and that PyBullet's scene agrees with."""
        return [grasp for grasp in trials.held if self._finisher.stands(grasp)]

    def _answer_of(self, grasps: tuple[Grasp, ...], deadline: float | None) -> Answer:
        """Rank, choose, and say what came of it."""
        tried = self._tried_grasps()
        monitor, request, part, finisher = self.monitor, self.request, self.part, self._finisher
        notes: tuple[str, ...] = ()
        if self.settings.scene.confirm and finisher.n_seen:
            notes += (
                f"PyBullet's scene confirmed {finisher.n_seen - finisher.n_disagreed} of "
                f"{finisher.n_seen} grasps.",
            )
        funnel = finisher.funnel(None if tried is None else tried.ranked)
        code, message, best_attempt = self._verdict(grasps, tried, funnel)
        if tried is not None:
            notes += (*tried.notes, *payload_note(part, self.settings.verification))
            if code in (ErrorCode.SUCCESS, ErrorCode.CANCELLED):
                grasps = tried.held if request.verification == "require" else tried.ranked
            else:
                grasps = ()
        with monitor.phase(Phase.PLACING):
            ordered, of_hold = self._hold.ranked(grasps, deadline, monitor)
        chosen = tuple(ordered[: request.n_grasps])
        # What a fine mesh's search has found is not closed on all of the mesh yet.
        estimates = RESERVE if self._prepared.coarse is None else 0
        left_out = grasps if tried is None else tried.ranked
        reserve = choose_reserve(self._context, chosen, left_out, estimates)
        result = make_result(
            part,
            self._context,
            self.settings,
            request,
            self.place,
            monitor,
            code,
            message
            or found_text(
                part.mesh_id,
                len(chosen),
                funnel.blocked,
                placed=bool(self._constraints),
                by_hold=self._hold.needed,
            ),
            chosen,
            best_attempt,
            notes + of_hold,
            reserve,
            tuple(self._convergence),
            funnel,
            self._tally.lost_palms,
        )
        support = self.place.around().support
        return Answer(
            result,
            tuple(finisher.clearance_of(grasp) for grasp in chosen),
            None if support is None else support.normal,
        )

    def _tried_grasps(self) -> TriedGrasps | None:
        """All that was finished, with its trials; None where none were asked for."""
        if self._trials is None:
            return None
        return TriedGrasps.of(
            self._finisher.finished(),
            self._trials,
            self.part.max_radius,
            self._objective,
        )

    def _verdict(
        self, grasps: Sequence[Grasp], tried: TriedGrasps | None, funnel: Funnel
    ) -> tuple[ErrorCode, str, Grasp | None]:
        """Code, message (empty for grasps that are answered) and the nearest miss."""
        part, finisher, archive = self.part, self._finisher, self._archive
        miss = grasp_of(archive.best_attempt, self._context) if archive.best_attempt else None
        if self.monitor.cancelled:
            return (
                ErrorCode.CANCELLED,
                f"Planning for '{part.mesh_id}' was cancelled.",
                None if grasps else miss,
            )
        if self._limit is not None:
            return self._limit.code, self._limit.message, None
        if not grasps:
            code, text = nothing_found(
                part, self.hand, self._evaluator.n_attempts, funnel, finisher.n_disagreed
            )
            return code, text, miss
        require = self.request.verification == "require"
        if tried is not None and not tried.held and (tried.n_tried or require):
            text = nothing_holds(part, len(tried.ranked), tried.why_none)
            return ErrorCode.NO_GRASP_HOLDS, text, tried.ranked[0]
        return ErrorCode.SUCCESS, "", None
