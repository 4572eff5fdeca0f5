"""Simulated annealing on the auto-grasp quality energy: the paper's "random" planner.

Every state's hand closes from its posture (AutoGrasp), and the energy is the quality of what it
then holds:

    E = -30 volume - 100 max(epsilon, 0).

States in which the hand collides are refused and count as tried.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_benchmark.rivals.annealer import StateAnnealing
from gpis_grasp_benchmark.rivals.hand_states import HandStates
from gpis_grasp_benchmark.rivals.settings import RivalSettings
from gpis_grasp_planner.grasp.evaluator import Attempts, AttemptStatus
from gpis_grasp_planner.search.context import PlanningContext, posture_evaluator

Array = NDArray[np.float64]

VOLUME_WEIGHT = 30.0
EPSILON_WEIGHT = 100.0
_STATES_PER_STEP = 32


def auto_grasp_energy(attempts: Attempts) -> Array:
    """Energies (B,) of closed hands; inf where the hand collided, 0 where it holds nothing."""
    energy = -VOLUME_WEIGHT * attempts.volume - EPSILON_WEIGHT * np.maximum(attempts.epsilon, 0.0)
    energy = np.where(attempts.status == AttemptStatus.GRASPED, energy, 0.0)
    illegal = (AttemptStatus.PALM_COLLISION, AttemptStatus.SELF_COLLISION)
    return np.where(np.isin(attempts.status, illegal), np.inf, energy)


class AutoGraspAnnealing:
    """The search "annealing".

    Parameters
    ----------
    context : PlanningContext
        Its archive takes every closed hand.
    settings : RivalSettings, optional
    """

    finished = False

    def __init__(self, context: PlanningContext, settings: RivalSettings | None = None):
        settings = settings or RivalSettings()
        self._context = context
        self._evaluator = posture_evaluator(context)
        self._states = HandStates(context, settings)
        self._walk = StateAnnealing(
            self._states.variables, context.rng, last_step=settings.last_step
        )

    def step(self) -> None:
        """Try some states."""
        for _ in range(_STATES_PER_STEP):
            T, joints = self._states.hands(self._walk.ask()[None])
            attempts = self._evaluator.attempt_from(T, joints)
            self._context.archive.add(attempts)
            self._walk.tell(float(auto_grasp_energy(attempts)[0]))
