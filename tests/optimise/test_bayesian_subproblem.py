"""ADMM whose two sub-problems are solved by Bayesian optimisation, on a known problem."""

import numpy as np
import pytest
from scipy.optimize import minimize

from gpis_grasp_planner.optimise.admm import AdmmSettings, solve_admm
from gpis_grasp_planner.optimise.bayesian import BayesianSettings
from gpis_grasp_planner.optimise.bayesian_subproblem import (
    BayesianSubproblem,
    SubproblemSettings,
)
from gpis_grasp_planner.optimise.domain import BoxDomain

DOMAIN = BoxDomain([-1.0, -1.0], [1.0, 1.0])
WISH = np.array([0.8, 0.2])
CENTRE, RADIUS, WEIGHT = np.array([-0.2, 0.1]), 0.3, 50.0


def objective(X):
    """Wants to be at WISH."""
    return -((X - WISH) ** 2).sum(axis=1)


def penalty(X):
    """Charges the excess over a disc, as the contact threshold does."""
    return WEIGHT * np.maximum(np.linalg.norm(X - CENTRE, axis=1) - RADIUS, 0.0) ** 2


def subproblem(function, seed, **values):
    return BayesianSubproblem(
        function,
        DOMAIN,
        SubproblemSettings(**values),
        BayesianSettings(n_initial=10),
        seed=seed,
    )


@pytest.mark.parametrize("learn_penalty", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_admm_reaches_the_optimum_of_the_sum(seed, learn_penalty):
    expected = minimize(
        lambda x: float(penalty(x[None])[0] - objective(x[None])[0]),
        CENTRE,
        method="Nelder-Mead",
        options={"xatol": 1e-8, "fatol": 1e-12},
    ).x
    solve_q = subproblem(objective, seed, learn_penalty=learn_penalty)
    solve_z = subproblem(lambda X: -penalty(X), seed + 10, learn_penalty=learn_penalty)
    result = solve_admm(
        solve_q,
        solve_z,
        np.zeros(2),
        DOMAIN.lower,
        DOMAIN.upper,
        AdmmSettings(rho=2.0, max_iterations=40, primal_tolerance=0.02, dual_tolerance=0.02),
    )
    print(f"seed {seed}: {result.iterations} iterations, q {result.q}, expected {expected}")
    assert result.converged
    np.testing.assert_allclose(result.q, expected, atol=0.06)
    np.testing.assert_allclose(result.z, expected, atol=0.06)


def test_one_call_is_the_proximal_step_and_stays_warm():
    solve = subproblem(objective, 1, first_evaluations=30, update_evaluations=6)
    for k, centre in enumerate([np.array([-0.5, 0.5]), np.array([-0.4, 0.4])]):
        rho = 3.0
        got = solve(centre, rho, np.zeros(2))
        # argmax -|x - w|^2 - rho/2 |x - c|^2
        expected = (2 * WISH + rho * centre) / (2 + rho)
        np.testing.assert_allclose(got, expected, atol=0.05)
        assert len(solve.points) == 30 + 6 * k
    np.testing.assert_array_equal(solve.function_values, objective(solve.points))


def test_no_point_is_evaluated_twice_for_the_centre_or_the_start():
    calls = []

    def counted(X):
        calls.extend(map(tuple, X))
        return objective(X)

    solve = subproblem(counted, 2, first_evaluations=15, update_evaluations=3)
    answer = solve(np.zeros(2), 1.0, np.zeros(2))
    for _ in range(3):
        answer = solve(answer, 1.0, answer)
    assert len(calls) == len(set(calls)) == len(solve.points)


def test_a_flat_black_box_answers_the_centre():
    solve = subproblem(lambda X: np.zeros(len(X)), 3, first_evaluations=12)
    centre = np.array([0.23, -0.71])
    np.testing.assert_array_equal(solve(centre, 5.0, np.ones(2)), centre)


@pytest.mark.parametrize("batch", [1, 4])
def test_the_run_is_fixed_by_its_seed(batch):
    def run():
        solve = subproblem(objective, 4, first_evaluations=20, batch=batch)
        solve(np.zeros(2), 1.0, np.zeros(2))
        return solve(np.full(2, 0.3), 1.0, np.zeros(2)), solve.points

    (a, points_a), (b, points_b) = run(), run()
    np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(points_a, points_b)
