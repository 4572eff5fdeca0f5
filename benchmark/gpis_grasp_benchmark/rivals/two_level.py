"""Two-level planning: EigenGrasp's states seed a strict auto-grasp annealing.

The parent walks as in `eigengrasp`. Its good states (energy below a threshold, distinct) queue as
seeds, best first. A child takes a seed and anneals around it for a limited number of steps on
the strict energy: approach along the palm's axis, close, E = -30 volume - 100 max(epsilon, 0);
a hand that holds nothing is as bad as can be. Meanwhile the parent stays away from all seeds
that were taken and from what their children found, and heats up anew if it stands near.

In the original, parent and child are threads; here they share one core in turns given by the
numbers of their states, so that a run is repeatable.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_benchmark.rivals.annealer import StateAnnealing
from gpis_grasp_benchmark.rivals.auto_grasp import auto_grasp_energy
from gpis_grasp_benchmark.rivals.best_states import BestStates
from gpis_grasp_benchmark.rivals.eigengrasp import approach_and_close
from gpis_grasp_benchmark.rivals.hand_states import N_POSE, HandStates
from gpis_grasp_benchmark.rivals.settings import RivalSettings
from gpis_grasp_benchmark.rivals.simulated_annealing import AnnealingSettings
from gpis_grasp_planner.grasp.order import pose_difference
from gpis_grasp_planner.search.context import PlanningContext, posture_evaluator

Array = NDArray[np.float64]

STRICT_ACCEPTANCE = AnnealingSettings(
    initial_temperature=10.0,
    cooling_rate=0.22,
    schedule_dimension=2.0,
    first_step=0,
    energy_scale=1.0,
)
STRICT_STEPS = AnnealingSettings(
    initial_temperature=10.0,
    cooling_rate=0.72,
    schedule_dimension=2.0,
    first_step=0,
    energy_scale=1.0,
)
POSE_CONFIDENCE = 0.65
POSTURE_CONFIDENCE = 0.5
HOLDS_NOTHING = 1e8
_CHECK_EVERY = 100
_TRIES_PER_STEP = 11


def strict_energy(energy: float) -> float:
    """Auto-grasp energy of a child: a hand that holds nothing is as bad as can be."""
    return HOLDS_NOTHING if energy == 0.0 else energy


class Child:
    """One strict annealing around a seed.

    Parameters
    ----------
    context : PlanningContext
    states : HandStates
    seed : (dim,) array
    settings : RivalSettings
    """

    def __init__(
        self, context: PlanningContext, states: HandStates, seed: Array, settings: RivalSettings
    ):
        self._context = context
        self._settings = settings
        self._evaluator = posture_evaluator(context)
        self._states = states
        confidence = np.full(len(seed), POSTURE_CONFIDENCE)
        confidence[:N_POSE] = POSE_CONFIDENCE
        self._walk = StateAnnealing(
            states.variables,
            context.rng,
            start=seed,
            acceptance=STRICT_ACCEPTANCE,
            steps=STRICT_STEPS,
            target=seed,
            confidence=confidence,
        )
        self._tries = 0

    @property
    def finished(self) -> bool:
        """Whether its steps, or ten times as many tries, are used up."""
        limit = self._settings.child_steps
        return self._walk.step >= limit or self._tries >= _TRIES_PER_STEP * limit

    @property
    def best_state(self) -> Array:
        """State (dim,) of lowest energy."""
        return self._walk.best_state

    def step(self) -> None:
        """Try one state."""
        T, joints = self._states.hands(self._walk.ask()[None])
        reach = self._settings.approach_m
        attempts = approach_and_close(self._evaluator, T, joints, reach)
        self._context.archive.add(attempts)
        self._walk.tell(strict_energy(float(auto_grasp_energy(attempts)[0])))
        self._tries += 1


class TwoLevelAnnealing:
    """The search "eigengrasp-two-level".

    Parameters
    ----------
    context : PlanningContext
        Its archive takes every hand that a child closes.
    settings : RivalSettings, optional

    Attributes
    ----------
    seeds : BestStates
        States that wait for a child.
    avoided : (n, 4, 4) array
        Poses of the palm's face that the parent keeps away from.
    n_children : int
        Children started so far.
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
        self.seeds = BestStates(
            context.max_radius, self._settings.best_states, self._settings.seeds_apart
        )
        self.avoided = np.zeros((0, 4, 4))
        self._child: Child | None = None
        self.n_children = 0

    def step(self) -> None:
        """Walk some states of the parent, the child in between."""
        share = self._settings.states_per_child_state
        for k in range(_CHECK_EVERY):
            self._walk_parent()
            if self._child is not None and k % share == 0 and not self._child.finished:
                self._child.step()
        self._look_after_child()

    def _walk_parent(self) -> None:
        state = self._walk.ask()
        T_face = self._states.faces(state[None])
        if self._is_avoided(T_face[0]):
            self._walk.tell(np.inf)
            return
        energy = float(self._evaluator.guided_potential(*self._states.hands(state[None]))[0])
        if self._walk.tell(energy) and energy < min(
            self._settings.seed_energy, self.seeds.worst_energy
        ):
            self.seeds.offer(energy, state, T_face[0])

    def _look_after_child(self) -> None:
        if self._child is not None and self._child.finished:
            self._avoid(self._states.faces(self._child.best_state[None]))
            self._child = None
        if self._child is None and self.seeds.entries:
            seed = self.seeds.entries.pop(0)
            self._avoid(seed.T_object_face[None])
            self._child = Child(self._context, self._states, seed.state, self._settings)
            self.n_children += 1
            if self._is_avoided(self._states.faces(self._walk.state[None])[0]):
                self._walk.restart()

    def _avoid(self, T_face: Array) -> None:
        self.avoided = np.concatenate([self.avoided, T_face])

    def _is_avoided(self, T_face: Array) -> bool:
        difference = pose_difference(self.avoided, T_face, self._context.max_radius)
        return bool(np.any(difference < self._settings.seeds_apart))
