"""The record of a plan: its grasps, with all that is needed to recompute their figures."""

from __future__ import annotations

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.funnel import Funnel
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.lost_palms import LostPalms
from gpis_grasp_planner.grasp.reserve import Reserve
from gpis_grasp_planner.plan.progress import Monitor
from gpis_grasp_planner.plan.request import PlanRequest, PlanResult
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.quality.balance_factor import CASE_BALANCE
from gpis_grasp_planner.quality.figures import ALWAYS, named
from gpis_grasp_planner.quality.surface_knowledge import SURFACE_HOLD
from gpis_grasp_planner.search.context import PlanningContext
from gpis_grasp_planner.surroundings.place import Place


def make_result(
    part: Part,
    context: PlanningContext,
    settings: PlannerSettings,
    request: PlanRequest,
    place: Place,
    monitor: Monitor,
    code: ErrorCode,
    message: str,
    grasps: tuple[Grasp, ...],
    best_attempt: Grasp | None,
    notes: tuple[str, ...],
    reserve: Reserve,
    convergence: tuple[tuple[float, int, float], ...],
    funnel: Funnel,
    lost_palms: LostPalms,
) -> PlanResult:
    """Put together what was asked, with what it was planned, and what came of it.

    The fields are those of `PlanResult`; `notes` come after the part's own.
    """
    hand, scene = context.hand, settings.scene
    measured = [measure.figure for measure in context.reported]
    of_surface = [] if part.uncertainty is None else [SURFACE_HOLD]
    # Grasps of an earlier plan may have it where this one tried none.
    known = any(CASE_BALANCE.name in grasp.quality.measured for grasp in grasps)
    of_cases = [CASE_BALANCE] if known or request.verification != "none" else []
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
        friction=context.evaluator.friction,
        hand=hand.name,
        link_names=hand.link_names,
        joint_names=hand.joint_names,
        joint_count=hand.joint_count,
        request=request,
        settings=settings.as_dict(),
        elapsed_s=monitor.elapsed_s,
        evaluations=context.evaluator.n_attempts,
        notes=part.notes + notes,
        convergence=convergence,
        place=place.as_mapping_if_stated(),
        reserve=reserve,
        funnel=funnel,
        lost_palms=lost_palms,
        objective=context.objective.text,
        figures=tuple(named([*ALWAYS, *measured, *of_surface, *of_cases]).values()),
        phase_s={str(phase): spent for phase, spent in monitor.phase_s.items()},
    )
