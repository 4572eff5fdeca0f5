"""Whether grasps hold on other surfaces that a scanned part may have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.plan.preparation import PreparedObject
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.quality.surface_knowledge import SURFACE_HOLD
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.surroundings.hold_probability import estimate_hold

_WHERE_IT_WAS_PLANNED = np.zeros((1, 6))


class SurfaceJudge:
    """Closes the hand on every surface drawn for a part.

    Parameters
    ----------
    part : Part
    hand, settings, prepared
    request : PlanRequest
        Its friction.
    """

    def __init__(
        self,
        part: Part,
        hand: HandDescription,
        settings: PlannerSettings,
        prepared: PreparedObject,
        request: PlanRequest,
    ):
        self._hand, self._settings = hand, settings.uncertainty
        friction = request.friction_for(part.friction)
        self._evaluators = [
            CompiledEvaluator(hand, drawn, friction, settings.scene, *made)
            for drawn, made in zip(part.drawn, prepared.draws, strict=True)
        ]

    def judged(self, grasp: Grasp) -> Grasp:
        """The grasp with its `surface_hold`; as it is for a mesh file. About 3 ms a surface."""
        if not self._evaluators:
            return grasp
        weight = np.ones(1)
        held = [
            estimate_hold(
                evaluator, self._hand, grasp, _WHERE_IT_WAS_PLANNED, weight, self._settings
            ).probability
            for evaluator in self._evaluators
        ]
        figures = {**grasp.quality.measured, SURFACE_HOLD.name: float(np.mean(held))}
        return replace(grasp, quality=replace(grasp.quality, measured=figures))
