"""A sub-problem of ADMM solved by Bayesian optimisation, warm over the iterations (Alg. 3).

The black box is evaluated once per point and never again: only the quadratic consensus term
changes from one iteration to the next, and it is known in closed form. Two ways to use that:

- default: the model learns the black box alone, and the quadratic enters the acquisition as an
  exact shift of the mean. All uncertainty left is the black box's, and nothing is refitted.
- the paper's, ``learn_penalty``: the model learns the sum; its targets are retold for every new
  centre ("Update BO_q, BO_z").
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.optimise.acquisition_search import AcquisitionSearchSettings
from gpis_grasp_planner.optimise.bayesian import BayesianOptimiser, BayesianSettings
from gpis_grasp_planner.optimise.domain import Domain
from gpis_grasp_planner.optimise.gaussian_process import GaussianProcessSettings
from gpis_grasp_planner.settings import SettingsGroup, setting

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SubproblemSettings(SettingsGroup):
    """Evaluations a sub-problem may spend."""

    first_evaluations: int = setting(
        30, low=1, high=100000, description="Evaluations in the first iteration."
    )
    update_evaluations: int = setting(
        8, low=1, high=100000, description="Evaluations in each later iteration."
    )
    batch: int = setting(1, low=1, high=1000, description="Points asked for at a time.")
    learn_penalty: bool = setting(
        False, description="Learn the consensus term with the model, as the paper does."
    )


class BayesianSubproblem:
    """Callable (centre, rho, start) -> best x of function(x) - rho/2 |x - centre|^2.

    Parameters
    ----------
    function : callable
        Batch (n, dim) -> (n,), to be maximised; for the z step of ADMM hand in -g.
    domain : Domain
    settings : SubproblemSettings, optional
    bayesian_settings, process_settings, search_settings : optional
        As for :class:`.bayesian.BayesianOptimiser`. `n_initial` comes off `first_evaluations`.
    seed : int or numpy Generator

    Notes
    -----
    The answer is the best point evaluated so far in any iteration, re-ranked for the present
    centre. The centre itself is always among them: where the black box is flat it is the answer.
    """

    def __init__(
        self,
        function: Callable[[Array], Array],
        domain: Domain,
        settings: SubproblemSettings | None = None,
        bayesian_settings: BayesianSettings | None = None,
        process_settings: GaussianProcessSettings | None = None,
        search_settings: AcquisitionSearchSettings | None = None,
        seed: int | np.random.Generator = 0,
    ):
        self.settings = settings or SubproblemSettings()
        self.function = function
        self.domain = domain
        self.optimiser = BayesianOptimiser(
            domain,
            settings=bayesian_settings,
            process_settings=process_settings,
            search_settings=search_settings,
            seed=seed,
        )
        self.function_values = np.zeros(0)

    @property
    def points(self) -> Array:
        """Every point (n, dim) the black box was evaluated at; values in `function_values`."""
        return self.optimiser.X

    def __call__(self, centre: Array, rho: float, start: Array) -> Array:
        """Solve for one centre; `start` is evaluated too if it is new."""

        def consensus(X: Array) -> Array:
            return -0.5 * rho * ((X - centre) ** 2).sum(axis=1)

        first = self.optimiser.n_observations == 0
        if self.settings.learn_penalty:
            self.optimiser.retell(self.function_values + consensus(self.points))
        else:
            self.optimiser.known_term = consensus
        budget = self.settings.first_evaluations if first else self.settings.update_evaluations
        spent = self._evaluate(self._new(np.stack([centre, start])), consensus)
        while spent < budget:
            X = self.optimiser.ask_batch(min(self.settings.batch, budget - spent))
            spent += self._evaluate(X, consensus)
        return self.optimiser.best.x

    def _new(self, X: Array) -> Array:
        X = np.unique(self.domain.clip(X), axis=0)
        known = (X[:, None, :] == self.points[None, :, :]).all(axis=2).any(axis=1)
        return X[~known]

    def _evaluate(self, X: Array, consensus: Callable[[Array], Array]) -> int:
        if len(X) == 0:
            return 0
        values = np.asarray(self.function(X), dtype=float)
        told = values + consensus(X) if self.settings.learn_penalty else values
        self.optimiser.tell(X, told)
        self.function_values = np.concatenate([self.function_values, values])
        return len(X)
