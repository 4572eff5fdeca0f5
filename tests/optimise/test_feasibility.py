"""What a constraint forbids is learnt beside the values, not as values."""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.optimise.bayesian import BayesianOptimiser, BayesianSettings
from gpis_grasp_planner.optimise.domain import BoxDomain
from gpis_grasp_planner.optimise.feasibility import FeasibilityModel

DOMAIN = BoxDomain([0.0, 0.0], [1.0, 1.0])


def model(points: np.ndarray, feasible: np.ndarray) -> FeasibilityModel:
    made = FeasibilityModel(DOMAIN.distance)
    made.tell(DOMAIN.features(points), feasible)
    return made


def probability(made: FeasibilityModel, points: list[list[float]], scale: float) -> np.ndarray:
    n_scales = len(DOMAIN.distance.scale_bounds)
    return made.probability(DOMAIN.features(np.array(points)), np.full(n_scales, scale))


def test_without_a_constraint_all_is_certain() -> None:
    made = FeasibilityModel(DOMAIN.distance)
    assert made.is_certain
    made.tell(DOMAIN.features(np.random.default_rng(0).random((5, 2))), np.ones(5, dtype=bool))
    assert made.is_certain
    assert (probability(made, [[0.5, 0.5]], 0.1) == 1.0).all()


def test_neighbours_decide_and_far_away_it_is_open() -> None:
    rng = np.random.default_rng(1)
    left = np.column_stack([0.1 + 0.02 * rng.random(30), rng.random(30)])
    right = np.column_stack([0.9 + 0.02 * rng.random(10), rng.random(10)])
    made = model(np.vstack([left, right]), np.repeat([False, True], [30, 10]))
    low, high, far = probability(made, [[0.1, 0.5], [0.9, 0.5], [0.5, 0.5]], 0.05)
    assert 0.0 < low < 0.01
    assert high > 0.99
    assert 0.1 < far < 0.6


def test_a_long_record_is_thinned_and_says_the_same() -> None:
    rng = np.random.default_rng(2)
    points = rng.random((3000, 2))
    made = FeasibilityModel(DOMAIN.distance)
    for rows in np.split(points, 60):
        made.tell(DOMAIN.features(rows), rows[:, 0] > 0.5)
    assert len(made._feasible) <= 480
    low, high = probability(made, [[0.2, 0.5], [0.8, 0.5]], 0.05)
    assert low < 0.15
    assert high > 0.85


def best_at_the_border(learn: bool, seed: int) -> float:
    """Best value found where the values rise towards a border beyond which all is forbidden."""
    optimiser = BayesianOptimiser(DOMAIN, settings=BayesianSettings(n_initial=10), seed=seed)
    best = 0.0
    for _ in range(30):
        x = optimiser.ask()
        feasible = bool(x[0] + 0.3 * x[1] < 0.8)
        value = float(x[0] + 0.3 * x[1] - (x[1] - 0.5) ** 2) if feasible else 0.0
        best = max(best, value)
        optimiser.tell(x, value, feasible=np.array([feasible]) if learn else None)
    return best


def test_the_best_lies_at_the_border_and_is_found_sooner() -> None:
    seeds = range(12)
    print("seeds 0 to 11")
    learnt = [best_at_the_border(True, seed) for seed in seeds]
    as_zero = [best_at_the_border(False, seed) for seed in seeds]
    print(np.mean(learnt), np.mean(as_zero))
    assert np.mean(0.8 - np.array(learnt)) < 0.7 * np.mean(0.8 - np.array(as_zero))


def test_what_is_forbidden_is_no_observation() -> None:
    optimiser = BayesianOptimiser(DOMAIN, seed=0)
    optimiser.tell([[0.2, 0.2], [0.8, 0.8]], [1.0, 5.0], feasible=[True, False])
    assert optimiser.n_observations == 1
    assert optimiser.best.y == 1.0
    assert not optimiser.feasibility.is_certain
