"""The evaluator of a search: the compiled one in its wrappers, or PyBullet's; and the exact one."""

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
) -> Iterator[tuple[GraspEvaluator, Tally]]:
    """The evaluator, and where it counts what is lost.

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
            yield bullet, bullet.tally
        return
    compiled, tally = _wrapped(
        *(part, hand, friction, settings, prepared.for_search),
        *(constraints, objective, ended),
    )
    yield compiled, tally


def exact_closing(
    part: Part,
    hand: HandDescription,
    friction: Friction,
    settings: PlannerSettings,
    prepared: PreparedObject,
    constraints: Sequence[Constraint],
    objective: Objective,
) -> Callable[[Candidate], Candidate | None]:
    """What makes a candidate of :func:`search_evaluator` one of the whole mesh."""
    if prepared.coarse is None or settings.scene.search_evaluator == "bullet":
        return lambda candidate: candidate
    evaluator, _ = _wrapped(
        part, hand, friction, settings, prepared, constraints, objective, lambda: False
    )
    return ExactClosing(evaluator, hand, objective)


def _wrapped(
    part: Part,
    hand: HandDescription,
    friction: Friction,
    settings: PlannerSettings,
    prepared: PreparedObject,
    constraints: Sequence[Constraint],
    objective: Objective,
    ended: Callable[[], bool],
) -> tuple[PostureEvaluator, Tally]:
    scene = settings.scene
    compiled = CompiledEvaluator(hand, part, friction, scene, prepared.field, prepared.tree, ended)
    constrained = ConstrainedEvaluator(compiled, hand, tuple(constraints), scene.retreat_m)
    balanced = with_balance(constrained, hand, part, settings)
    return with_measures(balanced, objective.measures, part, scene.cone_edges), constrained.tally
