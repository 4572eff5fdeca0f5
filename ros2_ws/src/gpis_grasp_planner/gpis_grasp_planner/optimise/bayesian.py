"""Bayesian optimisation, ask and tell (paper, section III; Alg. 1 without anything of a grasp).

Latin hypercube start, Gaussian process with Matern 5/2, hyperparameters by RProp, expected
improvement maximised over the continuous domain.

>>> domain = BoxDomain([-5.0, 0.0], [10.0, 15.0])
>>> optimiser = BayesianOptimiser(domain, seed=1)
>>> for _ in range(40):
...     x = optimiser.ask()
...     optimiser.tell(x, function(x))
>>> optimiser.best.x, optimiser.best.y
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.optimise.acquisition import log_expected_improvement
from gpis_grasp_planner.optimise.acquisition_search import (
    AcquisitionSearchSettings,
    candidates,
    maximise_acquisition,
    refine,
)
from gpis_grasp_planner.optimise.candidate_posterior import CandidatePosterior
from gpis_grasp_planner.optimise.distances import Distance
from gpis_grasp_planner.optimise.domain import Domain
from gpis_grasp_planner.optimise.feasibility import FeasibilityModel
from gpis_grasp_planner.optimise.gaussian_process import GaussianProcess, GaussianProcessSettings
from gpis_grasp_planner.optimise.observation_window import choose_window
from gpis_grasp_planner.settings import SettingsGroup, setting

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BayesianSettings(SettingsGroup):
    """Parameters of the Bayesian optimiser."""

    n_initial: int = setting(
        20, low=1, high=100000, description="Latin hypercube points before the model is asked."
    )
    xi: float = setting(
        1e-4,
        low=0.0,
        high=10.0,
        description="Margin of expected improvement, in standard deviations of the targets.",
    )
    refit_growth: float = setting(
        1.25,
        low=1.0,
        high=100.0,
        description="Hyperparameters are optimised anew when the observations grew by this factor.",
    )
    max_observations: int = setting(
        300, low=10, high=5000, description="Observations in the model; beyond, a window of them."
    )


@dataclass(frozen=True)
class Observation:
    """A point (dim,) and its value."""

    x: Array
    y: float


class BayesianOptimiser:
    """Maximises a black box over a domain.

    Parameters
    ----------
    domain : Domain
    distance : Distance, optional
        Replaces the domain's.
    settings : BayesianSettings, optional
    process_settings : GaussianProcessSettings, optional
    search_settings : AcquisitionSearchSettings, optional
    seed : int or numpy Generator
        The same seed and answers give the same questions.
    known_term : callable, optional
        (n, dim) -> (n,), a cheap term of the objective that need not be learnt (an ADMM
        penalty): the model learns what is told, the sum is maximised. May be exchanged at any
        time through the attribute of that name.
    to_beat : callable, optional
        (n, dim) -> (n,), what an observation at each point has to exceed to be an improvement.
        Default: the best observation, everywhere. For a search that collects several optima.
    """

    def __init__(
        self,
        domain: Domain,
        distance: Distance | None = None,
        settings: BayesianSettings | None = None,
        process_settings: GaussianProcessSettings | None = None,
        search_settings: AcquisitionSearchSettings | None = None,
        seed: int | np.random.Generator = 0,
        known_term: Callable[[Array], Array] | None = None,
        to_beat: Callable[[Array], Array] | None = None,
    ):
        self.domain = domain
        self.settings = settings or BayesianSettings()
        self.search_settings = search_settings or AcquisitionSearchSettings()
        self.process = GaussianProcess(distance or domain.distance, process_settings)
        self.known_term = known_term
        self.to_beat = to_beat
        self._rng = np.random.default_rng(seed)
        self._initial = domain.sample(self.settings.n_initial, self._rng)
        self._n_initial_asked = 0
        self.X = np.zeros((0, domain.dim))
        self.y = np.zeros(0)
        self._features = np.zeros((0, self.process.distance.n_features))
        self._n_in_process = 0
        self._window = np.zeros(0, dtype=np.intp)
        self._next_refit = 0.0
        self.feasibility = FeasibilityModel(self.process.distance)

    @property
    def n_observations(self) -> int:
        """Observations told so far."""
        return len(self.y)

    @property
    def best(self) -> Observation:
        """Best observation so far, known term included.

        Raises
        ------
        RequestError
            If nothing was told yet.
        """
        if self.n_observations == 0:
            raise RequestError("Nothing was told yet, so there is no best; call tell first.")
        objective = self.objective
        index = int(np.argmax(objective))
        return Observation(self.X[index].copy(), float(objective[index]))

    @property
    def objective(self) -> Array:
        """Told values plus the known term (n,)."""
        if self.known_term is None:
            return self.y
        return self.y + self.known_term(self.X)

    def ask(self) -> Array:
        """Point (dim,) to evaluate next."""
        return self.ask_batch(1)[0]

    def ask_batch(self, k: int) -> Array:
        """Points (k, dim) to evaluate next.

        The first `n_initial` are the Latin hypercube's. Later ones maximise expected
        improvement one after the other, each imagined to return the model's mean (the kriging
        believer), so that they spread; the whole batch costs little more than one point.
        """
        first = min(k, len(self._initial) - self._n_initial_asked)
        chosen = list(self._initial[self._n_initial_asked : self._n_initial_asked + first])
        self._n_initial_asked += first
        if len(chosen) < k and self.n_observations == 0:
            chosen.extend(self.domain.sample(k - len(chosen), self._rng))
        if len(chosen) < k:
            chosen.extend(self._ask_model(k - len(chosen)))
        return np.asarray(chosen)

    def tell(
        self,
        X: ArrayLike,
        y: ArrayLike,
        features: ArrayLike | None = None,
        feasible: ArrayLike | None = None,
    ) -> None:
        """Take values y (n,) at points X (n, dim), or one of each.

        Parameters
        ----------
        features : (n, p) array_like, optional
            Where the evaluation moved the point (a local adaption), the features of what was
            evaluated in the end; default: those of X.
        feasible : (n,) bool array_like, optional
            Which points a constraint allowed; default: all. The others' values do not count: they
            are no observations, but lower the probability that their neighbours are feasible.
        """
        X = np.atleast_2d(np.asarray(X, dtype=float))
        y = np.atleast_1d(np.asarray(y, dtype=float))
        if X.shape != (len(y), self.domain.dim):
            raise RequestError(
                f"Told points {X.shape} and values {y.shape}; give (n, {self.domain.dim}) and (n,)."
            )
        if not (np.all(np.isfinite(X)) and np.all(np.isfinite(y))):
            raise RequestError(
                "A told point or value is NaN or infinite; map failures to a finite bad value."
            )
        new = self.domain.features(X) if features is None else np.atleast_2d(features)
        allowed = np.ones(len(y), dtype=bool) if feasible is None else np.atleast_1d(feasible)
        self.feasibility.tell(new, allowed)
        X, y, new = X[allowed], y[allowed], new[allowed]
        self.X = np.vstack([self.X, X])
        self.y = np.concatenate([self.y, y])
        self._features = np.vstack([self._features, new])

    def retell(self, y: ArrayLike) -> None:
        """Replace all values (n,): the points, features and hyperparameters stay.

        For an objective that changed at points where it can be computed anew, such as the
        sub-problems of ADMM ("Update BO", Alg. 3).
        """
        y = np.atleast_1d(np.asarray(y, dtype=float))
        if y.shape != self.y.shape or not np.all(np.isfinite(y)):
            raise RequestError(
                f"Retold {y.shape} values for {self.y.shape} points; give one finite value each."
            )
        self.y = y.copy()
        if self.process.n_observations:
            self._update_process(optimise=False, rebuild=True)

    def _update_process(self, optimise: bool = True, rebuild: bool = False) -> None:
        n, limit = self.n_observations, self.settings.max_observations
        due = optimise and n >= self._next_refit
        new = np.arange(self._n_in_process, n)
        pool = np.concatenate([self._window, new])
        if len(self._window) and not (due or rebuild) and len(pool) <= limit:
            if len(new):
                self.process.append(self._features[new], self.y[new])
        else:
            if len(pool) > limit:
                # Down to three quarters, so that the next appends are cheap again; out of the
                # present window and the new ones, so that the cost does not grow with the record.
                best_first = self.objective[pool]
                pool = pool[choose_window(self._features[pool], best_first, (3 * limit) // 4)]
            self.process.fit(self._features[pool], self.y[pool], optimise=due)
            if due:
                self._next_refit = n * self.settings.refit_growth
        self._window, self._n_in_process = pool, n

    def _to_beat(self, X: Array, best: float) -> Array:
        return np.full(len(X), best) if self.to_beat is None else self.to_beat(X)

    def _ask_model(self, k: int) -> list[Array]:
        self._update_process()
        objective = self.objective
        order = np.argsort(-objective, kind="stable")[: self.search_settings.n_incumbents]
        incumbents, best = self.X[order], float(objective.max())
        xi = self.settings.xi * self.process.target_std

        def acquisition(X: Array) -> Array:
            features = self.domain.features(X)
            mean, std = self.process.predict(features)
            score = log_expected_improvement(mean + self._known(X), std, self._to_beat(X, best), xi)
            return score + self._log_feasible(features)

        if k == 1:
            x, _ = maximise_acquisition(
                acquisition, self.domain, incumbents, self.search_settings, self._rng
            )
            return [x]

        def spread(X: Array) -> NDArray[np.intp]:
            features = self.domain.features(X)
            posterior, log_feasible = (
                CandidatePosterior(self.process, features, k),
                self._log_feasible(features),
            )
            mean = posterior.mean + self._known(X)
            chosen: list[int] = []
            taken = np.zeros(len(X), dtype=bool)
            believed = self._to_beat(X, best)
            for _ in range(k):
                score = log_expected_improvement(mean, posterior.std, believed, xi) + log_feasible
                score[taken] = -np.inf
                index = int(np.argmax(score))
                chosen.append(index)
                taken |= np.all(np.equal(X, X[index]), axis=1)
                posterior.believe(index)
                if self.to_beat is None:
                    believed = np.maximum(believed, mean[index])
            return np.asarray(chosen)

        # Spread starts, climb from all of them at once, and choose again among both: two starts
        # that climbed the same peak count once, and the next best candidate takes the place.
        X = candidates(self.domain, incumbents, self.search_settings, self._rng)
        starts = X[spread(X)]
        refined, _ = refine(
            acquisition, self.domain, starts, acquisition(starts), self.search_settings, self._rng
        )
        pool = np.vstack([refined, X])
        return list(pool[spread(pool)])

    def _log_feasible(self, features: Array) -> Array | float:
        if self.feasibility.is_certain:
            return 0.0
        return np.log(self.feasibility.probability(features, self.process.length_scales))

    def _known(self, X: Array) -> Array | float:
        return 0.0 if self.known_term is None else self.known_term(X)


def maximise(
    function: Callable[[Array], float],
    domain: Domain,
    n_evaluations: int,
    settings: BayesianSettings | None = None,
    process_settings: GaussianProcessSettings | None = None,
    search_settings: AcquisitionSearchSettings | None = None,
    seed: int | np.random.Generator = 0,
) -> BayesianOptimiser:
    """Evaluate `function` (x (dim,) -> float) that many times; the optimiser holds the record."""
    optimiser = BayesianOptimiser(
        domain,
        settings=settings,
        process_settings=process_settings,
        search_settings=search_settings,
        seed=seed,
    )
    for _ in range(n_evaluations):
        x = optimiser.ask()
        optimiser.tell(x, function(x))
    return optimiser
