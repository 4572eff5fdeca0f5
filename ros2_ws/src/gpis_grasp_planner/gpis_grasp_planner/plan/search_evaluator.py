"""The evaluator of a search: the compiled one in its wrappers, or PyBullet's."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.grasp.constrained_evaluator import ConstrainedEvaluator
from gpis_grasp_planner.grasp.constraint import Constraint
from gpis_grasp_planner.grasp.evaluator import GraspEvaluator, PostureEvaluator
from gpis_grasp_planner.grasp.measured import with_measures
from gpis_grasp_planner.grasp.tally import Tally
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.plan.closing_balance import with_balance
from gpis_grasp_planner.plan.exact_closing import ExactClosing
from gpis_grasp_planner.plan.preparation import PreparedObject
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.quality.objective import Objective
from gpis_grasp_planner.scene.bullet_evaluator import BulletEvaluator
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.search.archive import Candidate

Exact = Callable[[Candidate], Candidate | None]


@contextmanager
def search_evaluator(
    part: Part,
    hand: HandDescription,
    friction: Friction,
    settings: PlannerSettings,
    prepared: PreparedObject,
    constraints: Sequence[Constraint],
    objective: Objective,
    ended: Callable[[], bool],
) -> Iterator[tuple[GraspEvaluator, Tally, Exact]]:
    """The evaluator, where it counts what is lost, and what closes its grasps on all of the mesh.

    Around the compiled one, from the inside: constraints, the closing balance, and the measures
    that the objective needs.

    Parameters
    ----------
    part, hand, friction, settings, prepared
    constraints : sequence of Constraint
        `scene.search_evaluator: bullet` knows none of them.
    objective : Objective
    ended : callable
        True once no further hand is to be closed, not even of a begun batch.
    """
    scene = settings.scene
    if scene.search_evaluator == "bullet":
        with BulletEvaluator(hand, part, friction, scene, prepared.field, prepared.tree) as bullet:
            yield bullet, bullet.tally, _as_it_is
        return

    def wrapped(of: PreparedObject, is_over: Callable[[], bool]) -> tuple[PostureEvaluator, Tally]:
        compiled = CompiledEvaluator(hand, part, friction, scene, of.field, of.tree, is_over)
        constrained = ConstrainedEvaluator(compiled, hand, tuple(constraints), scene.retreat_m)
        balanced = with_balance(constrained, hand, part, settings)
        measured = with_measures(balanced, objective.measures, part, scene.cone_edges)
        return measured, constrained.tally

    exact: Exact = _as_it_is
    if prepared.coarse is not None:
        exact = ExactClosing(wrapped(prepared, lambda: False)[0], hand, objective)
    yield (*wrapped(prepared.for_search, ended), exact)


def _as_it_is(candidate: Candidate) -> Candidate:
    return candidate
