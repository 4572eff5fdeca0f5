"""Maximisation of an acquisition function over a continuous domain (Alg. 1, line 5).

One batch of candidates, half of them spread over the domain and half around the incumbents,
then a batched pattern search from the best few: in every round each start gets a handful of
random neighbours at a shrinking radius and moves to the best of them. It needs no derivative of
the features, and costs one batched prediction a round.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from gpis_grasp_planner.optimise.domain import Domain
from gpis_grasp_planner.settings import SettingsGroup, setting

Array = NDArray[np.float64]

DIFFERENCE_STEP = 1e-6
"""Forward differences of the polish, relative to the domain."""

NO_SLOPE = 1e10
"""What the polish sees where the acquisition is not finite."""


@dataclass(frozen=True)
class AcquisitionSearchSettings(SettingsGroup):
    """How thoroughly the acquisition is maximised."""

    n_random: int = setting(400, low=1, high=100000, description="Candidates over the domain.")
    n_incumbents: int = setting(
        5, low=0, high=1000, description="Best observations to search around."
    )
    n_around: int = setting(40, low=1, high=10000, description="Candidates around each of them.")
    n_starts: int = setting(5, low=1, high=1000, description="Best candidates that are refined.")
    n_rounds: int = setting(8, low=0, high=1000, description="Rounds of refinement.")
    n_neighbours: int = setting(12, low=1, high=1000, description="Neighbours per start and round.")
    radius_start: float = setting(
        0.08, low=1e-6, high=1.0, description="First radius, relative to the domain."
    )
    radius_end: float = setting(
        0.002, low=1e-9, high=1.0, description="Last radius, relative to the domain."
    )
    polish_iterations: int = setting(
        0, low=0, high=1000, description="Iterations of L-BFGS-B from the winner; 0 is off."
    )


def candidates(
    domain: Domain,
    incumbents: Array,
    settings: AcquisitionSearchSettings,
    rng: np.random.Generator,
) -> Array:
    """Candidates (n, dim): spread over the domain, and around the incumbents (k, dim).

    Radii around an incumbent are log-uniform over the two settings.
    """
    spread = domain.sample(settings.n_random, rng)
    if len(incumbents) == 0:
        return spread
    centres = np.repeat(incumbents, settings.n_around, axis=0)
    low, high = np.log(settings.radius_end), np.log(settings.radius_start * 2.0)
    radii = np.exp(rng.uniform(low, high, size=len(centres)))
    return np.vstack([spread, domain.perturb(centres, radii, rng)])


def refine(
    acquisition: Callable[[Array], Array],
    domain: Domain,
    starts: Array,
    values: Array,
    settings: AcquisitionSearchSettings,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Climb from each start (k, dim) with value (k,); never worse than it.

    Returns
    -------
    points : (k, dim) array
    values : (k,) array
    """
    points, values = np.array(starts), np.array(values)
    k = len(points)
    if settings.n_rounds == 0 or k == 0:
        return points, values
    # More starts than usual (a batch) share the neighbours of the usual number.
    m = max(4, settings.n_neighbours * settings.n_starts // max(k, settings.n_starts))
    rows = np.arange(k)
    for radius in np.geomspace(settings.radius_start, settings.radius_end, settings.n_rounds):
        trial = domain.perturb(np.repeat(points, m, axis=0), np.full(k * m, radius), rng)
        trial_values = acquisition(trial).reshape(k, m)
        best = trial_values.argmax(axis=1)
        better = trial_values[rows, best] > values
        points[better] = trial.reshape(k, m, -1)[rows, best][better]
        values[better] = trial_values[rows, best][better]
    return points, values


def polish(
    acquisition: Callable[[Array], Array],
    domain: Domain,
    start: Array,
    value: float,
    iterations: int,
) -> tuple[Array, float]:
    """Climb from `start` (dim,) by L-BFGS-B with forward differences; never worse than it.

    The differences of one gradient are one batch of dim + 1 points, so a gradient costs about
    as much as a single value. Periodic coordinates are free, the others bounded.
    """
    width = domain.upper - domain.lower
    steps = np.vstack([np.zeros(domain.dim), DIFFERENCE_STEP * np.eye(domain.dim)])

    def negative(unit: Array) -> tuple[float, Array]:
        # Steps go inward at the upper bound, where an outward one would be clipped away.
        inward = np.where((unit > 0.5) & ~domain.periodic, -1.0, 1.0)
        values = acquisition(domain.clip(domain.lower + (unit + inward * steps) * width))
        if not np.all(np.isfinite(values)):
            return NO_SLOPE, np.zeros(domain.dim)
        return -float(values[0]), -(values[1:] - values[0]) / (DIFFERENCE_STEP * inward)

    bounds = [(None, None) if free else (0.0, 1.0) for free in domain.periodic]
    result = minimize(
        negative,
        (start - domain.lower) / width,
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": iterations},
    )
    if result.fun < min(-value, NO_SLOPE):
        return domain.clip((domain.lower + result.x * width)[None])[0], -float(result.fun)
    return start, value


def maximise_acquisition(
    acquisition: Callable[[Array], Array],
    domain: Domain,
    incumbents: Array,
    settings: AcquisitionSearchSettings,
    rng: np.random.Generator,
) -> tuple[Array, float]:
    """Best point (dim,) found, and the acquisition there.

    Parameters
    ----------
    acquisition : callable
        Batch (n, dim) -> (n,).
    incumbents : (k, dim) array
        Best observations, best first.
    """
    X = candidates(domain, incumbents, settings, rng)
    values = acquisition(X)
    top = np.argsort(-values, kind="stable")[: settings.n_starts]
    points, best = refine(acquisition, domain, X[top], values[top], settings, rng)
    winner = int(np.argmax(best))
    if settings.polish_iterations == 0:
        return points[winner], float(best[winner])
    return polish(
        acquisition, domain, points[winner], float(best[winner]), settings.polish_iterations
    )
