"""Simulated annealing with the schedule of the original simulator (GraspIt!).

Temperature over the step k, neighbours and acceptance:

    T(k) = T0 exp(-c k^(1/D)),                       T0 = 1e6, c = 7, D = 8, k from 30000
    step = sign(v) T ((1 + 1/T)^|v| - 1) range,      v uniform in [-1, 1]
    P(accept) = min(1, exp(s (E_old - E_new) / T)),  s = 1e-6

This is the "very fast simulated re-annealing" neighbourhood (L. Ingber, 1989): at a small T
about log-uniform between T and the whole range, so large jumps never die out. The start at
k = 30000 means T = 9.4e-6 from the first step.

Ask and tell, so that the caller evaluates in its own way and stops when it likes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.settings import SettingsGroup, setting

Array = NDArray[np.float64]

RESAMPLES = 100
"""Draws for a coordinate that keeps leaving its range; then it stays where it is."""


@dataclass(frozen=True)
class AnnealingSettings(SettingsGroup):
    """Parameters of the schedule; the defaults are the original simulator's."""

    initial_temperature: float = setting(
        1e6, low=1e-12, high=1e15, description="T0 of the cooling schedule."
    )
    cooling_rate: float = setting(7.0, low=0.0, high=1e3, description="c of the schedule.")
    schedule_dimension: float = setting(8.0, low=1.0, high=100.0, description="D of the schedule.")
    first_step: int = setting(30000, low=0, high=10**9, description="k of the first step.")
    energy_scale: float = setting(
        1e-6, low=0.0, high=1e12, description="Factor of energy differences in the acceptance."
    )


def temperature(step: ArrayLike, settings: AnnealingSettings | None = None) -> Array:
    """Temperature T(k) at steps k (any shape)."""
    s = settings or AnnealingSettings()
    k = np.asarray(step, dtype=float)
    return s.initial_temperature * np.exp(-s.cooling_rate * k ** (1.0 / s.schedule_dimension))


def neighbour_step(v: ArrayLike, T: float) -> Array:
    """Step relative to the range, in [-1, 1], for v in [-1, 1] (odd, increasing, 1 at v = 1)."""
    v = np.asarray(v, dtype=float)
    return np.sign(v) * T * np.expm1(np.abs(v) * np.log1p(1.0 / T))


def acceptance_probability(
    energy_old: float, energy_new: float, T: float, scale: float = 1e-6
) -> float:
    """Probability of moving to a new energy; 1 for any that is not higher."""
    if not energy_new > energy_old:
        return 1.0
    return float(np.exp(scale * (energy_old - energy_new) / T))


class SimulatedAnnealing:
    """Minimises an energy over variables with ranges, some of which wrap around.

    Parameters
    ----------
    lower, upper : (dim,) array_like
    periodic : (dim,) array_like of bool, optional
        Variables that wrap from upper to lower.
    start : (dim,) array_like, optional
        Default: uniform in the ranges.
    settings : AnnealingSettings, optional
    seed : int or numpy Generator

    Attributes
    ----------
    state, energy : (dim,) array and float
        Where the walk is; the energy is inf until the first legal state.
    best_state, best_energy
        The lowest energy seen.
    step : int
        k of the schedule; only legal states advance it.
    """

    def __init__(
        self,
        lower: ArrayLike,
        upper: ArrayLike,
        periodic: ArrayLike | None = None,
        start: ArrayLike | None = None,
        settings: AnnealingSettings | None = None,
        seed: int | np.random.Generator = 0,
    ):
        self.lower = np.atleast_1d(np.asarray(lower, dtype=float))
        self.upper = np.atleast_1d(np.asarray(upper, dtype=float))
        if self.lower.shape != self.upper.shape or not np.all(self.lower < self.upper):
            raise RequestError(
                f"Ranges from {self.lower.tolist()} to {self.upper.tolist()}; every lower bound "
                "must be below its upper bound."
            )
        self.periodic = np.zeros(len(self.lower), dtype=bool)
        if periodic is not None:
            self.periodic = np.asarray(periodic, dtype=bool)
        self.settings = settings or AnnealingSettings()
        self._rng = np.random.default_rng(seed)
        if start is None:
            start = self._rng.uniform(self.lower, self.upper)
        self.state = self._inside(np.array(start, dtype=float))
        self.energy = np.inf
        self.best_state, self.best_energy = self.state.copy(), np.inf
        self.step = self.settings.first_step
        self._candidate: Array | None = None

    @property
    def temperature(self) -> float:
        """Temperature at the present step."""
        return float(temperature(self.step, self.settings))

    def ask(self) -> Array:
        """State (dim,) to evaluate next: first the start, then neighbours of the state.

        Asking again without telling gives another neighbour.
        """
        if np.isinf(self.energy) and self._candidate is None:
            self._candidate = self.state.copy()
        else:
            self._candidate = self.neighbour(self.state)
        return self._candidate.copy()

    def tell(self, energy: float) -> bool:
        """Take the energy of the asked state; returns whether the walk moved there.

        An infinite energy marks an illegal state: it is refused and does not cool. NaN is
        an error.
        """
        if self._candidate is None:
            raise RequestError("An energy was told before a state was asked for; call ask first.")
        if np.isnan(energy):
            raise RequestError("The energy is NaN; tell inf for a state that is not legal.")
        if energy == np.inf:
            return False
        if energy < self.best_energy:
            self.best_state, self.best_energy = self._candidate.copy(), float(energy)
        probability = acceptance_probability(
            self.energy, energy, self.temperature, self.settings.energy_scale
        )
        accepted = bool(self._rng.random() < probability)
        if accepted:
            self.state, self.energy = self._candidate.copy(), float(energy)
        self.step += 1
        return accepted

    def neighbour(self, state: ArrayLike) -> Array:
        """Random neighbour (dim,): every variable moves; one that leaves its range draws again."""
        state = np.asarray(state, dtype=float)
        width, T = self.upper - self.lower, self.temperature
        result = state.copy()
        open_ = np.ones(len(state), dtype=bool)
        for _ in range(RESAMPLES):
            trial = state + width * neighbour_step(self._rng.uniform(-1, 1, len(state)), T)
            trial = np.where(self.periodic, self.lower + np.mod(trial - self.lower, width), trial)
            fits = open_ & (trial >= self.lower) & (trial <= self.upper)
            result[fits] = trial[fits]
            open_ &= ~fits
            if not open_.any():
                break
        return result

    def _inside(self, state: Array) -> Array:
        width = self.upper - self.lower
        wrapped = self.lower + np.mod(state - self.lower, width)
        return np.where(self.periodic, wrapped, np.clip(state, self.lower, self.upper))
