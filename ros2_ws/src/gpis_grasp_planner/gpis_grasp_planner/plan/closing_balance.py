"""The closing balance that a plan's settings ask for."""

from __future__ import annotations

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.balanced_evaluator import BalancedEvaluator
from gpis_grasp_planner.grasp.evaluator import PostureEvaluator
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.quality.closing_balance import ClosingBalance

# A protocol without pushes still gives forces that are left over a scale.
_LEAST_ACCELERATION_M_S2 = 1.0


def with_balance(
    evaluator: PostureEvaluator,
    hand: HandDescription,
    part: Part,
    settings: PlannerSettings,
    mass_kg: float | None = None,
) -> PostureEvaluator:
    """An evaluator whose grasps have their imbalance; itself where the settings do not ask.

    Forces and pushes are those of the trials (forces the hand's own, if its description has
    them), so that the search looks for what they will find. The pushes are of `mass_kg`; None: of
    the trials' deciding case.
    """
    share, trial = settings.hpp.balance_friction_share, settings.verification
    if share == 0.0:
        return evaluator
    balance = ClosingBalance(
        hand,
        part.center_of_mass,
        part.max_radius,
        share,
        *trial.forces_n(hand.drive),
        (trial.mass_kg if mass_kg is None else mass_kg)
        * max(trial.acceleration_m_s2, _LEAST_ACCELERATION_M_S2),
    )
    return BalancedEvaluator(evaluator, balance)
