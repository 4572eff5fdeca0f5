"""The planner as a whole: prepare an object, run a search within a budget, choose the answer.

This is the one place where the scene's evaluator, the surface and the searches are put together;
the ROS node and the command line call nothing below it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.grasp.constrained_evaluator import ConstrainedEvaluator
from gpis_grasp_planner.grasp.constraint import Constraint
from gpis_grasp_planner.grasp.evaluator import GraspEvaluator
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import DEFAULT_HAND, load_hand
from gpis_grasp_planner.plan.constraints import make_constraints
from gpis_grasp_planner.plan.preparation import Preparation, PreparedObject
from gpis_grasp_planner.plan.request import PlanRequest, PlanResult, Progress
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.scene.bullet_evaluator import BulletEvaluator
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.search.archive import GraspArchive
from gpis_grasp_planner.search.context import PlanningContext, Search
from gpis_grasp_planner.search.finalists import choose_finalists, choose_reserve, grasp_of
from gpis_grasp_planner.search.searches import check_planner, make_search
from gpis_grasp_planner.surroundings.obstacles import Surroundings
from gpis_grasp_planner.surroundings.place import Place
from gpis_grasp_planner.verification.cases import finalist_cases
from gpis_grasp_planner.verification.finalist_trials import FinalistTrials
from gpis_grasp_planner.verification.selection import Selection, select

_PROGRESS_INTERVAL_S = 0.1
_SECONDS_PER_FINALIST = 0.09
_SECONDS_AFTER_CANCEL = 0.2
_SHORTEST_ROUND_S = 1.0


@dataclass(frozen=True, eq=False)
class _Task:
    """What one call of :meth:`GraspPlanner.plan` works on; `start` by ``time.monotonic``."""

    part: Part
    request: PlanRequest
    start: float
    prepared: PreparedObject
    on_progress: Callable[[Progress], None] | None
    should_stop: Callable[[], bool] | None
    place: Place
    trials: FinalistTrials | None = None


class GraspPlanner:
    """Plans grasps for parts; keeps what it prepared for the last few meshes.

    Parameters
    ----------
    settings : PlannerSettings, optional
    hand : str
        Name of the hand's model.
    """

    def __init__(self, settings: PlannerSettings | None = None, hand: str = DEFAULT_HAND):
        self.settings = settings or PlannerSettings()
        self.hand = load_hand(hand)
        self._preparation = Preparation(self.settings)

    def prepare(self, part: Part) -> PreparedObject:
        """Fit the surface and sample the distance field of a part (0.3 to 1.5 s), once.

        May be called from several threads.
        """
        return self._preparation.of(part)

    def plan(
        self,
        part: Part,
        request: PlanRequest,
        on_progress: Callable[[Progress], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
        place: Place | None = None,
    ) -> PlanResult:
        """Plan grasps of a part, in the part's own frame.

        Parameters
        ----------
        part : Part
        request : PlanRequest
        on_progress : callable, optional
            Called with a Progress about ten times a second.
        should_stop : callable, optional
            Asked between steps (10 to 100 ms); True ends the plan with code CANCELLED and the
            grasps whose exact quality is known within 0.2 s more.
        place : Place, optional
            Where the part lies now. The plan is good for other places all the same; only the
            trials in physics follow it: grasps that are clear of the surroundings come first, and
            displacements are drawn from the pose's covariance.

        Returns
        -------
        PlanResult
            With code SUCCESS, NO_FEASIBLE_GRASP, NO_GRASP_HOLDS or CANCELLED. The search ends in
            time to compute the finalists' exact quality within the budget, and to try them where
            that was asked for; if none of them holds it goes on with the time that is left.

        Raises
        ------
        RequestError
            For an unknown planner, or surroundings with the search in PyBullet.
        """
        check_planner(request.planner)
        task = _Task(
            part,
            request,
            time.monotonic(),
            self.prepare(part),
            on_progress,
            should_stop,
            place or Place(),
        )
        if request.verification == "none":
            return self._plan_in_scene(task)
        # Forks, and so before the scene has clients: the cover is made while the search runs.
        prepared = task.prepared
        trials = FinalistTrials(
            part, self.hand, self.settings.verification, prepared.field, prepared.tree
        )
        try:
            return self._plan_in_scene(replace(task, trials=trials))
        finally:
            trials.close()

    def _plan_in_scene(self, task: _Task) -> PlanResult:
        part, request, prepared = task.part, task.request, task.prepared
        friction = request.friction_for(part.friction)
        scene = self.settings.scene
        if scene.search_evaluator == "bullet":
            if request.surroundings is not None:
                raise RequestError(
                    "The search in PyBullet (scene.search_evaluator is 'bullet') knows no "
                    "surroundings; set it to 'compiled'."
                )
            bullet = BulletEvaluator(
                self.hand, part, friction, scene, prepared.field, prepared.tree
            )
            with bullet:
                return self._plan(task, bullet)
        compiled = CompiledEvaluator(
            self.hand, part, friction, scene, prepared.field, prepared.tree
        )
        T_world_object = task.place.T_world_object
        around = (request.surroundings or Surroundings()).moved(T_world_object)
        constraints = make_constraints(
            self.hand, request, Place(T_world_object, around), self.settings
        )
        evaluator: GraspEvaluator = compiled
        if constraints:
            evaluator = ConstrainedEvaluator(compiled, self.hand, constraints, scene.retreat_m)
        return self._plan(task, evaluator, constraints)

    def _plan(
        self, task: _Task, evaluator: GraspEvaluator, constraints: tuple[Constraint, ...] = ()
    ) -> PlanResult:
        part, request, prepared, start = task.part, task.request, task.prepared, task.start
        should_stop, trials = task.should_stop, task.trials
        scene = self.settings.scene
        friction = evaluator.friction
        archive = GraspArchive(part.max_radius, self.settings.hpp.volume_weight)
        context = PlanningContext(
            part=part,
            hand=self.hand,
            evaluator=evaluator,
            atlas=prepared.atlas,
            archive=archive,
            settings=self.settings.search,
            rng=np.random.default_rng(request.seed),
            constraints=constraints,
        )
        search = make_search(request.planner, context)
        convergence: list[tuple[float, int, float]] = []
        for_hulls = min(0.4 * request.time_budget_s, _SECONDS_PER_FINALIST * request.n_grasps)
        share = self.settings.verification.budget_share if trials is not None else 0.0
        end = start + request.time_budget_s
        left = request.time_budget_s
        selection: Selection | None = None
        while True:
            cancelled = _search_until(
                end - for_hulls - share * left, task, search, evaluator, archive, convergence
            )
            deadline = None if request.max_evaluations else end
            if cancelled:
                deadline = time.monotonic() + _SECONDS_AFTER_CANCEL
            grasps = choose_finalists(context, request.n_grasps, deadline)
            found = len(grasps)
            grasps, notes = self._confirmed(part, friction, prepared, grasps)
            further = choose_reserve(context, grasps)
            if trials is None or cancelled:
                break
            if grasps:
                selection = select(
                    trials,
                    finalist_cases(
                        part,
                        friction,
                        self.settings.verification,
                        request.seed,
                        task.place.covariance,
                    ),
                    grasps,
                    further,
                    self.settings.hpp.volume_weight,
                    deadline,
                    should_stop,
                    task.place.around(),
                    self.settings.clearance,
                    known=selection.known if selection is not None else None,
                )
            # Where nothing held there is nothing better to do with the time than to search on.
            left = end - time.monotonic()
            held = selection is not None and selection.held
            if held or search.finished or deadline is None or left < _SHORTEST_ROUND_S:
                break
        code, message = _verdict(part, evaluator.n_attempts, found, len(grasps), cancelled)
        best = archive.best_attempt
        best_attempt = grasp_of(best, context) if best is not None and not grasps else None
        if selection is not None and not cancelled:
            notes += (selection.note,)
            grasps, further = selection.split(request.n_grasps, request.verification == "require")
            if not grasps:
                code, message = _nothing_holds(part, selection)
                best_attempt = selection.ranked[0]
        return PlanResult(
            code=code,
            message=message,
            grasps=grasps,
            best_attempt=best_attempt,
            mesh_id=part.mesh_id,
            mesh_hash=part.mesh.content_hash,
            center_of_mass=part.center_of_mass,
            torque_scale=part.max_radius,
            mass=part.mass,
            cone_edges=scene.cone_edges,
            contact_threshold=scene.contact_threshold_m,
            friction=friction,
            hand=self.hand.name,
            link_names=self.hand.link_names,
            joint_names=self.hand.joint_names,
            request=request,
            settings=self.settings.as_dict(),
            elapsed_s=time.monotonic() - start,
            evaluations=evaluator.n_attempts,
            notes=part.notes + notes,
            convergence=tuple(convergence),
            reserve=further,
        )

    def _confirmed(
        self,
        part: Part,
        friction: Friction,
        prepared: PreparedObject,
        grasps: tuple[Grasp, ...],
    ) -> tuple[tuple[Grasp, ...], tuple[str, ...]]:
        """The grasps that PyBullet's scene agrees with, and a note that says how many."""
        scene = self.settings.scene
        if not scene.confirm or not grasps:
            return grasps, ()
        with BulletEvaluator(
            self.hand, part, friction, scene, prepared.field, prepared.tree
        ) as bullet:
            seen = bullet.confirm(grasps)
        kept = tuple(
            grasp
            for grasp, look in zip(grasps, seen, strict=True)
            if look.contacts_confirmed and look.penetration_m <= scene.confirm_tolerance_m
        )
        return kept, (f"PyBullet's scene confirmed {len(kept)} of {len(grasps)} grasps.",)


def _search_until(
    end: float,
    task: _Task,
    search: Search,
    evaluator: GraspEvaluator,
    archive: GraspArchive,
    convergence: list[tuple[float, int, float]],
) -> bool:
    """Step a search until `end` by ``time.monotonic``, or its limits; whether it was cancelled.

    One step is always taken: a budget shorter than the preparation still tries. Improvements of
    the best epsilon are appended to `convergence`.
    """
    request, limit = task.request, task.request.max_evaluations
    stepped = False
    next_progress = time.monotonic()
    while not search.finished:
        now = time.monotonic()
        if task.on_progress is not None and now >= next_progress:
            next_progress = now + _PROGRESS_INTERVAL_S
            task.on_progress(
                Progress(
                    now - task.start,
                    request.time_budget_s,
                    evaluator.n_attempts,
                    archive.best_epsilon,
                    len(archive),
                )
            )
        if task.should_stop is not None and task.should_stop():
            return True
        late = now >= end and stepped
        if late or (limit is not None and evaluator.n_attempts >= limit):
            break
        search.step()
        stepped = True
        if archive.best_epsilon > (convergence[-1][2] if convergence else 0.0):
            elapsed = time.monotonic() - task.start
            convergence.append((elapsed, evaluator.n_attempts, archive.best_epsilon))
    return False


def _nothing_holds(part: Part, selection: Selection) -> tuple[ErrorCode, str]:
    return (
        ErrorCode.NO_GRASP_HOLDS,
        f"None of {len(selection.ranked)} grasps of '{part.mesh_id}' was seen to hold in physics "
        f"({selection.why_none}). Give more time, or ask for grasps without that requirement.",
    )


def _verdict(
    part: Part, attempts: int, found: int, n_grasps: int, cancelled: bool
) -> tuple[ErrorCode, str]:
    if cancelled:
        return ErrorCode.CANCELLED, f"Planning for '{part.mesh_id}' was cancelled."
    if n_grasps:
        return ErrorCode.SUCCESS, f"{n_grasps} grasps of '{part.mesh_id}', best first."
    if found:
        return (
            ErrorCode.NO_FEASIBLE_GRASP,
            f"PyBullet's scene agreed with none of {found} grasps of '{part.mesh_id}' (limit: "
            "scene.confirm_tolerance_m). Give more time, or check the mesh for "
            "overlapping faces.",
        )
    extent = ", ".join(f"{1e3 * side:.0f}" for side in part.mesh.extent)
    return (
        ErrorCode.NO_FEASIBLE_GRASP,
        f"No grasp with force closure of '{part.mesh_id}' ({extent} mm) in {attempts} attempts. "
        "Give more time, check the friction and the mesh's unit, or use a part that the hand "
        "can span.",
    )
