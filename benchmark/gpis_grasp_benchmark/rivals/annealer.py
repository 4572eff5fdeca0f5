"""Simulated annealing as the original simulator's planners use it.

To `optimise.simulated_annealing` this adds what belongs to those planners: every variable has a
largest step of its own; steps and acceptance may cool at different rates; steps may be drawn
towards a target state (the seed of a child planner); and the schedule starts anew at its end.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_benchmark.rivals.hand_states import Variables
from gpis_grasp_benchmark.rivals.simulated_annealing import (
    RESAMPLES,
    AnnealingSettings,
    SimulatedAnnealing,
    neighbour_step,
    temperature,
)

Array = NDArray[np.float64]


class StateAnnealing(SimulatedAnnealing):
    """Annealing over hand states.

    Parameters
    ----------
    variables : Variables
    start : (dim,) array, optional
        Default: uniform in the ranges.
    acceptance, steps : AnnealingSettings, optional
        Schedules of the acceptance and of the step sizes; the second defaults to the first.
    target, confidence : (dim,) arrays, optional
        A state towards which steps are drawn: a variable's step comes from a Gaussian of
        variance 1 - confidence about the step that leads there.
    last_step : int, optional
        Step of the schedule at which it starts anew.
    rng : numpy Generator
    """

    def __init__(
        self,
        variables: Variables,
        rng: np.random.Generator,
        start: Array | None = None,
        acceptance: AnnealingSettings | None = None,
        steps: AnnealingSettings | None = None,
        target: Array | None = None,
        confidence: Array | None = None,
        last_step: int | None = None,
    ):
        super().__init__(
            variables.lower, variables.upper, variables.periodic, start, acceptance, rng
        )
        self._largest = variables.largest_step
        self._steps = steps or self.settings
        self._target = target
        self._deviation = None if confidence is None else np.sqrt(1.0 - confidence)
        self._last_step = last_step
        self._generator = rng

    @property
    def step_temperature(self) -> float:
        """Temperature of the step sizes."""
        return float(temperature(self.step, self._steps))

    def restart(self) -> None:
        """Heat up again; the next legal state is accepted whatever its energy."""
        self.step = self.settings.first_step
        self.energy = np.inf

    def tell(self, energy: float) -> bool:
        """As in the base class; starts anew at the end of the schedule."""
        accepted = super().tell(energy)
        if self._last_step is not None and self.step >= self._last_step:
            self.restart()
        return accepted

    def neighbour(self, state: Array) -> Array:  # type: ignore[override]
        """Random neighbour (dim,); variables that leave their range draw again."""
        T = self.step_temperature
        width = self.upper - self.lower
        mean = self._means(state, T)
        result = np.array(state, dtype=float)
        open_ = np.arange(len(result))
        for _ in range(RESAMPLES):
            v = self._draw(mean, open_)
            trial = result[open_] + self._largest[open_] * neighbour_step(v, T)
            lower, upper = self.lower[open_], self.upper[open_]
            wrapped = lower + np.mod(trial - lower, width[open_])
            trial = np.where(self.periodic[open_], wrapped, trial)
            fits = (trial >= lower) & (trial <= upper)
            result[open_[fits]] = trial[fits]
            open_ = open_[~fits]
            if not len(open_):
                break
        return result

    def _means(self, state: Array, T: float) -> Array | None:
        """Where on the scale of draws the steps to the target lie, (dim,) in [-1, 1]."""
        if self._target is None:
            return None
        change = np.clip((self._target - state) / self._largest, -1.0, 1.0)
        return np.asarray(np.sign(change) * np.log1p(np.abs(change) / T) / np.log1p(1.0 / T))

    def _draw(self, mean: Array | None, rows: NDArray[np.intp]) -> Array:
        if mean is None or self._deviation is None:
            return self._generator.uniform(-1.0, 1.0, len(rows))
        v = np.full(len(rows), 2.0)
        while (outside := np.abs(v) > 1.0).any():
            which = rows[outside]
            v[outside] = self._generator.normal(mean[which], self._deviation[which])
        return v
