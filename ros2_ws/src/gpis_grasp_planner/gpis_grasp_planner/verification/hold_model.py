"""How probably a grasp holds over the sampled cases, from what planning and its trials know.

Two logistic models, one of the first case and one of the further cases of grasps that passed it,
begin at weights that were learnt from other parts and go on with the trials of the answer at hand,
so that grasps that were tried say something about those that were not. What they expect of a
grasp is the prior of a Beta distribution, which its own trials then decide. Of a part that was
scanned both are about the surfaces that the grasp closes on: times `surface_hold`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv

from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.trials import HoldEstimate, TrialOutcome
from gpis_grasp_planner.quality.balance_factor import CASE_BALANCE, balance_factor
from gpis_grasp_planner.quality.surface_knowledge import SURFACE_HOLD
from gpis_grasp_planner.verification.logistic import Logistic

Array = NDArray[np.float64]

# Learnt by tests/benchmarks/hold_prior.py (docs/benchmark/hold_prior): means of the weights of
# features_of, in its order, and their deviation from part to part.
_FIRST = (-1.24, 3.91, 1.79, 0.01, 2.44)
_FURTHER = (0.50, -0.26, 0.12, 0.45, 2.74)
_DEVIATION = 1.0
# Trials of one grasp are much alike: for the model of its like a dozen count as one.
_SHARE = 1.0 / 12.0
# How many of its own trials a grasp's prior counts as.
_STRENGTH = 8.0
_LEAST_EPSILON = 1e-3
_LEAST_VOLUME = 1e-6
_SMALLEST = 0.02
_TAIL = 0.05  # on either side of an interval of 90 %


def features_of(grasp: Grasp) -> Array:
    """What is known of a grasp before its trials, (5,).

    1, how balanced it is (`quality.balance_factor`), log10 of epsilon and of volume, and how
    balanced over the cases of the trials (`case_balance`; where planned, if nobody asked).
    """
    balanced = 0.5 if grasp.imbalance is None else float(balance_factor(grasp.imbalance))
    in_cases = float(grasp.quality.measured.get(CASE_BALANCE.name, balanced))
    epsilon = np.log10(max(grasp.epsilon, _LEAST_EPSILON))
    volume = np.log10(max(grasp.volume, _LEAST_VOLUME))
    return np.array([1.0, balanced, epsilon, volume, in_cases])


def _surface_hold(grasp: Grasp) -> float:
    return float(grasp.quality.measured.get(SURFACE_HOLD.name, 1.0))


@dataclass(frozen=True, eq=False)
class BetaPosterior:
    """A Beta distribution over a probability.

    Attributes
    ----------
    alpha, beta : float
    """

    alpha: float
    beta: float

    @property
    def mean(self) -> float:
        """Expected probability."""
        return self.alpha / (self.alpha + self.beta)

    def quantile(self, share: float) -> float:
        """Below it the probability lies with the chance `share`."""
        return float(betaincinv(self.alpha, self.beta, share))


class HoldModel:
    """Learns from trials as they come, and tells what to expect of any grasp of the part."""

    def __init__(self) -> None:
        precision = np.eye(len(_FIRST)) / _DEVIATION**2
        self._priors = (
            Logistic(np.array(_FIRST), precision),
            Logistic(np.array(_FURTHER), precision),
        )
        self._first, self._further = self._priors
        # Features, share of the drawn surfaces, and outcomes of each grasp.
        self._seen: dict[bytes, tuple[Array, float, Sequence[TrialOutcome]]] = {}

    def learn(self, grasp: Grasp, outcomes: Sequence[TrialOutcome]) -> None:
        """Take the outcomes of a grasp so far, in place of what was told of it before (0.4 ms)."""
        key = grasp.T_object_palm.tobytes() + grasp.pregrasp_joints.tobytes()
        self._seen[key] = features_of(grasp), _surface_hold(grasp), tuple(outcomes)
        features, surface_hold, seen = zip(*self._seen.values(), strict=True)
        x = np.array(features)
        first = np.array([outcomes[0].passed for outcomes in seen], dtype=float)
        self._first = self._priors[0].updated(x, first, np.ones(len(x)))
        further = [outcomes[1:] for outcomes in seen]
        passed = np.array([sum(o.passed for o in each) for each in further], dtype=float)
        # Where its surface lets a grasp fall, that says nothing of how such grasps hold.
        n = np.maximum(np.array(surface_hold) * np.array([len(each) for each in further]), passed)
        self._further = self._priors[1].updated(x, passed * _SHARE, n * _SHARE)

    def posterior(self, grasp: Grasp, outcomes: Sequence[TrialOutcome]) -> BetaPosterior:
        """Over the probability that a further case is passed, given the cases made so far."""
        x = features_of(grasp)
        expected = float(self._further.probability(x))
        if not outcomes:
            expected *= float(self._first.probability(x))
        elif not outcomes[0].passed:
            expected = _SMALLEST
        expected *= _surface_hold(grasp)
        expected = min(max(expected, _SMALLEST), 1.0 - _SMALLEST)
        further = outcomes[1:]
        passed = sum(outcome.passed for outcome in further)
        return BetaPosterior(
            _STRENGTH * expected + passed, _STRENGTH * (1.0 - expected) + len(further) - passed
        )

    def estimate(self, grasp: Grasp) -> HoldEstimate:
        """The probability to hold of a grasp with its trials, and its interval."""
        outcomes = () if grasp.trials is None else grasp.trials.outcomes
        posterior = self.posterior(grasp, outcomes)
        return HoldEstimate(
            posterior.mean,
            posterior.quantile(_TAIL),
            posterior.quantile(1.0 - _TAIL),
            max(len(outcomes) - 1, 0),
        )
