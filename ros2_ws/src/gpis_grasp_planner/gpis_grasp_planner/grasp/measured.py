"""Figures of measures: for the attempts of a search, and for finished grasps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.evaluator import Attempts, AttemptStatus, PostureEvaluator
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.judging_evaluator import JudgingEvaluator
from gpis_grasp_planner.quality.measure import HeldPart, Measure
from gpis_grasp_planner.quality.measures import measured, value_of

Array = NDArray[np.float64]


def with_figures(
    grasp: Grasp,
    measures: Sequence[Measure],
    center_of_mass: Array,
    torque_scale: float,
    cone_edges: int,
) -> Grasp:
    """A grasp with the figures of measures; as it is where it has no force closure."""
    if not (grasp.feasible and measures):
        return grasp
    held = HeldPart(
        grasp.contacts, center_of_mass, torque_scale, cone_edges, grasp.T_object_palm, grasp.joints
    )
    figures = {**grasp.quality.measured, **measured(held, measures)}
    return replace(grasp, quality=replace(grasp.quality, measured=figures))


def with_measures(
    evaluator: PostureEvaluator, measures: Sequence[Measure], part: Part, cone_edges: int
) -> PostureEvaluator:
    """An evaluator whose attempts have the figures of measures; itself where there are none."""
    return MeasuringEvaluator(evaluator, measures, part, cone_edges) if measures else evaluator


class MeasuringEvaluator(JudgingEvaluator):
    """An evaluator that measures each attempt with force closure, once.

    Parameters
    ----------
    evaluator : PostureEvaluator
    measures : sequence of Measure
    part : Part
    cone_edges : int
        Of a friction pyramid.
    """

    def __init__(
        self,
        evaluator: PostureEvaluator,
        measures: Sequence[Measure],
        part: Part,
        cone_edges: int,
    ):
        super().__init__(evaluator)
        self._measures = tuple(measures)
        self._part, self._cone_edges = part, cone_edges

    def judged(self, attempts: Attempts) -> Attempts:
        """The attempts with a column for each measure."""
        closed = (attempts.status == AttemptStatus.GRASPED) & (attempts.epsilon > 0.0)
        columns = {m.figure.name: np.full(len(attempts), np.nan) for m in self._measures}
        for i in np.flatnonzero(closed):
            held = HeldPart(
                attempts.contacts(int(i)),
                self._part.center_of_mass,
                self._part.max_radius,
                self._cone_edges,
                attempts.T_object_palm[i],
                attempts.joints[i],
            )
            for measure in self._measures:
                columns[measure.figure.name][i] = value_of(measure, held)
        return replace(attempts, columns=columns)
