"""The planner as a whole: one road from a part, a request and a place to a ranked answer.

The ROS node, the command line and Python programs all come in here, by :meth:`GraspPlanner.answer`;
they call nothing below it to plan.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.plan.answer import Answer
from gpis_grasp_planner.plan.constraints import arm_constraint, make_constraints
from gpis_grasp_planner.plan.finisher import FinishedGrasp
from gpis_grasp_planner.plan.hold_ranking import HoldRanking
from gpis_grasp_planner.plan.kept_holds import KeptHolds
from gpis_grasp_planner.plan.objective import make_objective, settings_for
from gpis_grasp_planner.plan.own_constraints import own_constraints
from gpis_grasp_planner.plan.placed_grasps import GraspPlacing
from gpis_grasp_planner.plan.placing import KnownAnswer, place_known
from gpis_grasp_planner.plan.preparation import Preparation, PreparedObject
from gpis_grasp_planner.plan.progress import Monitor, Phase, Progress
from gpis_grasp_planner.plan.request import PlanRequest, PlanResult
from gpis_grasp_planner.plan.run import PlanRun
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.plan.warm_up import make_ready
from gpis_grasp_planner.search.searches import check_planner
from gpis_grasp_planner.surroundings.obstacles import Surroundings
from gpis_grasp_planner.surroundings.place import Place
from gpis_grasp_planner.surroundings.support_check import check_support
from gpis_grasp_planner.thread_limits import limited_threads


class GraspPlanner:
    """Plans grasps for parts; keeps what it prepared for the last few meshes.

    Parameters
    ----------
    settings : PlannerSettings, optional
        The hand is that of `settings.hand.model`.

    Raises
    ------
    RequestError
        If there is no such hand, or its files contradict each other.
    """

    def __init__(self, settings: PlannerSettings | None = None):
        self.settings = settings or PlannerSettings()
        self.hand = load_hand(self.settings.hand.model)
        self._preparation = Preparation(self.settings)
        self._kept_holds = KeptHolds()

    def prepare(self, part: Part, monitor: Monitor | None = None) -> PreparedObject:
        """Fit the surface and sample the distance field of a part (0.3 to 1.5 s), once.

        May be called from several threads.

        Raises
        ------
        PlanningError
            CANCELLED or DEADLINE_EXCEEDED by the monitor; in the latter case the work goes on.
        """
        if monitor is None:
            return self._preparation.of(part)
        with monitor.phase(Phase.PREPARING):
            return self._preparation.of(
                part,
                should_stop=monitor.stopped,
                late=lambda: monitor.left_s < 0.0,
            )

    @limited_threads()
    def answer(
        self,
        part: Part,
        request: PlanRequest,
        place: Place | None = None,
        *,
        known: PlanResult | None = None,
        monitor: Monitor | None = None,
    ) -> Answer:
        """Plan grasps of a part for the place where it lies.

        Parameters
        ----------
        part : Part
        request : PlanRequest
        place : Place, optional
            Where the part lies, what stands around it, how well its pose is known. The search
            knows all of it from its first proposal. Without, the part floats in free space.
        known : PlanResult, optional
            An earlier answer for this part, at any place, by the same settings, friction and
            objective; another is refused. What of it is good here is answered in some 0.1 s; only
            where that leaves nothing, or nothing that was tried as the request wants it, a search
            is made.
        monitor : Monitor, optional
            The request's clock and its line to the caller; the clock starts now if not given.
            Where it says that the request is cancelled, the answer has the code CANCELLED and the
            grasps that could be finished within 0.2 s more.

        Returns
        -------
        Answer
            Its result has the code SUCCESS, NO_FEASIBLE_GRASP, ALL_GRASPS_BLOCKED,
            NO_GRASP_HOLDS or CANCELLED.

        Raises
        ------
        RequestError
            For an unknown planner or objective, a part that reaches into its support
            (INVALID_SCENE), or constraints with the search in PyBullet.
        PoseError
            INVALID_COVARIANCE.
        PlanningError
            CANCELLED or DEADLINE_EXCEEDED while the part was prepared.
        """
        check_planner(request.planner)
        settings = settings_for(request, self.settings)
        make_objective(settings, part)  # before anything is prepared: whether it is known
        place = self.placed(place)
        if monitor is None:
            make_ready(request.planner)  # where nothing is compiled yet: once, before the clock
            monitor = Monitor(request.time_budget_s)
        asked = request.approach or request.forbidden or self.settings.constraints.names
        constrained = place.surroundings or asked
        if (
            constrained or place.T_world_arm is not None
        ) and self.settings.scene.search_evaluator == "bullet":
            raise RequestError(
                "The search in PyBullet (scene.search_evaluator is 'bullet') knows no "
                "constraints; set it to 'compiled'."
            )
        notes = check_support(part, place, self.settings.clearance)
        prepared = self.prepare(part, monitor)
        seeds: tuple[FinishedGrasp, ...] = ()
        if known is not None:
            earlier = self.known_answer(part, known, request, place, monitor)
            if earlier.satisfies(request):
                return _with_notes(replace(earlier.answer, from_known=True), notes)
            seeds = earlier.finished
        placing, hold = self._placing(part, prepared, request, place)
        with monitor.phase(Phase.PREPARING):
            run = PlanRun(part, settings, prepared, request, place, placing, hold, monitor)
        with run:
            return _with_notes(run.answer(seeds), notes)

    @limited_threads()
    def known_answer(
        self,
        part: Part,
        known: PlanResult,
        request: PlanRequest,
        place: Place,
        monitor: Monitor | None = None,
    ) -> KnownAnswer:
        """Answer from an earlier plan alone, without a search; see `plan.placing.place_known`."""
        monitor = monitor or Monitor(request.time_budget_s)
        place = self.placed(place)
        check_support(part, place, self.settings.clearance)
        prepared = self.prepare(part, monitor)
        placing, hold = self._placing(part, prepared, request, place)
        return place_known(known, part, place, request, placing, hold, monitor)

    def placed(self, place: Place | None) -> Place:
        """The place as this planner takes it: before the arm of its settings, if there is one."""
        place = Place() if place is None else place  # a bare pose is false, and counts all the same
        if not self.settings.arm.model:
            return replace(place, T_world_arm=None)
        return place if place.T_world_arm is not None else replace(place, T_world_arm=np.eye(4))

    def _placing(
        self, part: Part, prepared: PreparedObject, request: PlanRequest, place: Place
    ) -> tuple[GraspPlacing, HoldRanking]:
        arm = arm_constraint(self.hand, part, place, self.settings)
        own = own_constraints(self.hand, part, place, self.settings.constraints)
        elsewhere = replace(place, surroundings=Surroundings())
        placing = GraspPlacing(
            self.hand,
            place.around(),
            self.settings.clearance,
            prepared.tree,
            make_constraints(self.hand, request, elsewhere, self.settings, arm, own),
            arm,
            own,
        )
        settings = settings_for(request, self.settings)
        hold = HoldRanking(
            part, self.hand, settings, prepared, place.covariance, request, self._kept_holds
        )
        return placing, hold

    def plan(
        self,
        part: Part,
        request: PlanRequest,
        on_progress: Callable[[Progress], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
    ) -> PlanResult:
        """Plan grasps of a part that floats in free space: the result of :meth:`answer`."""
        make_ready(request.planner)
        monitor = Monitor(request.time_budget_s, on_progress, should_stop)
        return self.answer(part, request, monitor=monitor).result


def _with_notes(answer: Answer, notes: tuple[str, ...]) -> Answer:
    if not notes:
        return answer
    return replace(answer, result=replace(answer.result, notes=(*answer.result.notes, *notes)))
