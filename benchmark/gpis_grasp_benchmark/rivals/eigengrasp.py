"""EigenGrasp planning: annealing of palm pose and eigengrasps under the guided potential.

The potential (`scene.guided_potential`) needs no closing, so states are cheap. The best distinct
states are pre-grasps: each is approached along the palm's axis until contact, closed, and
measured. The original does that at the end of its time; here it happens as soon as a state has
entered the list of best ones, so that nothing is lost whenever the planner is stopped, and states
that are later replaced count as well.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_benchmark.rivals.annealer import StateAnnealing
from gpis_grasp_benchmark.rivals.best_states import BestStates
from gpis_grasp_benchmark.rivals.hand_states import HandStates
from gpis_grasp_benchmark.rivals.settings import RivalSettings
from gpis_grasp_planner.grasp.evaluator import Attempts, PostureEvaluator
from gpis_grasp_planner.search.context import PlanningContext, posture_evaluator

Array = NDArray[np.float64]

_STATES_PER_STEP = 128


def approach_and_close(
    evaluator: PostureEvaluator, T_object_palm: Array, joints: Array, reach: float
) -> Attempts:
    """Close hands after an approach of at most `reach` [m]; see the original's strict energy.

    Hands whose palm does not come to touch close where they were: that leaves room for fingertip
    grasps.
    """
    T_moved, touches = evaluator.approach(T_object_palm, joints, reach)
    T = np.where(touches[:, None, None], T_moved, T_object_palm)
    return evaluator.attempt_from(T, joints)


class EigenGraspAnnealing:
    """The search "eigengrasp".

    Parameters
    ----------
    context : PlanningContext
        Its archive takes the closed hands.
    settings : RivalSettings, optional
    """

    finished = False

    def __init__(self, context: PlanningContext, settings: RivalSettings | None = None):
        self._context = context
        self._settings = settings or RivalSettings()
        self._evaluator = posture_evaluator(context)
        self._states = HandStates(context, self._settings)
        self._walk = StateAnnealing(
            self._states.variables, context.rng, last_step=self._settings.last_step
        )
        self.best = BestStates(
            context.max_radius, self._settings.best_states, self._settings.states_apart
        )

    def step(self) -> None:
        """Walk some states, then close those that have entered the list."""
        for _ in range(_STATES_PER_STEP):
            state = self._walk.ask()
            T, joints = self._states.hands(state[None])
            energy = float(self._evaluator.guided_potential(T, joints)[0])
            if self._walk.tell(energy) and energy < self.best.worst_energy:
                self.best.offer(energy, state, self._states.faces(state[None])[0])
        self._close_new()

    def _close_new(self) -> None:
        fresh = [entry for entry in self.best.entries if not entry.closed]
        if not fresh:
            return
        for entry in fresh:
            entry.closed = True
        T, joints = self._states.hands(np.stack([entry.state for entry in fresh]))
        reach = self._settings.approach_m
        self._context.archive.add(approach_and_close(self._evaluator, T, joints, reach))
