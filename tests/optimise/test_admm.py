"""ADMM on convex problems with closed forms, and its residuals computed anew."""

import numpy as np
import pytest

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.optimise.admm import AdmmSettings, AdmmStatus, solve_admm

TIGHT = AdmmSettings(max_iterations=2000, primal_tolerance=1e-9, dual_tolerance=1e-9)


def quadratic_solver(H, b):
    """Argmin 1/2 x'Hx - b'x + rho/2 |x - v|^2; as q step: f = b'x - 1/2 x'Hx."""

    def solve(v, rho, start):
        return np.linalg.solve(H + rho * np.eye(len(b)), b + rho * v)

    return solve


def clip_solver(low, high):
    """Z step of g = 0: the projection onto the box."""

    def solve(v, rho, start):
        return np.clip(v, low, high)

    return solve


def constant(*value):
    """A sub-problem that always wants the same point."""

    def solve(v, rho, start):
        return np.array(value)

    return solve


def centre(v, rho, start):
    """The sub-problem of a flat function."""
    return v


def random_quadratic(seed, d=4):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(d, d))
    return A @ A.T + 0.5 * np.eye(d), 3.0 * rng.normal(size=d)


@pytest.mark.parametrize("seed", range(5))
def test_the_sum_of_two_quadratics_has_its_closed_form(seed):
    H1, b1 = random_quadratic(seed)
    H2, b2 = random_quadratic(seed + 100)
    expected = np.linalg.solve(H1 + H2, b1 + b2)
    wide = np.full(4, 100.0)
    result = solve_admm(
        quadratic_solver(H1, b1), quadratic_solver(H2, b2), np.zeros(4), -wide, wide, TIGHT
    )
    assert result.converged
    np.testing.assert_allclose(result.q, expected, atol=1e-7)
    np.testing.assert_allclose(result.z, expected, atol=1e-7)
    # The multiplier is the gradient of f at the optimum (stationarity of the Lagrangian).
    np.testing.assert_allclose(result.y, b1 - H1 @ expected, atol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_a_box_constrained_quadratic_programme_meets_the_optimality_conditions(seed):
    H, b = random_quadratic(seed)
    low, high = np.full(4, -0.4), np.full(4, 0.4)
    wide = np.full(4, 100.0)
    result = solve_admm(
        quadratic_solver(H, b), clip_solver(low, high), np.zeros(4), -wide, wide, TIGHT
    )
    assert result.converged
    slope = b - H @ result.z  # of the function maximised
    inside = (result.z > low + 1e-7) & (result.z < high - 1e-7)
    assert not inside.all()
    np.testing.assert_allclose(slope[inside], 0.0, atol=1e-6)
    assert np.all(slope[result.z >= high - 1e-7] >= -1e-6)
    assert np.all(slope[result.z <= low + 1e-7] <= 1e-6)


def test_the_lasso_s_soft_threshold_within_the_box():
    # max -1/2 |q - a|^2 - t |z|_1, whose answer is the soft threshold of a, cut at the box.
    a, t = np.array([3.0, -0.2, 0.9, -2.0, 0.5]), 0.5

    def soft(v, rho, start):
        return np.sign(v) * np.maximum(np.abs(v) - t / rho, 0.0)

    result = solve_admm(
        quadratic_solver(np.eye(5), a), soft, np.zeros(5), -np.ones(5), np.ones(5), TIGHT
    )
    expected = np.clip(np.sign(a) * np.maximum(np.abs(a) - t, 0.0), -1, 1)
    np.testing.assert_allclose(result.z, expected, atol=1e-7)
    assert result.z[1] == 0.0


def test_the_signs_as_printed_in_the_paper_run_away():
    # Maximising with +rho/2 |q - v|^2 makes the sub-problem convex: it ends in a corner.
    H, b = np.eye(2), np.array([0.3, 0.2])
    corners = np.array([[x, y] for x in (-1, 1) for y in (-1, 1)])
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 41)] * 2), -1).reshape(-1, 2)

    def printed(v, rho, start):
        values = grid @ b - 0.5 * np.einsum("ni,ij,nj->n", grid, H, grid)
        return grid[np.argmax(values + rho / 2 * ((grid - v) ** 2).sum(axis=1))]

    answer = printed(np.zeros(2), 4.0, None)
    assert (np.abs(corners - answer).sum(axis=1) == 0).any()
    settled = quadratic_solver(H, b)(np.zeros(2), 4.0, None)
    np.testing.assert_allclose(settled, b / 5.0)


@pytest.mark.parametrize("balance_ratio", [0.0, 5.0])
def test_residuals_are_what_they_are_defined_as(balance_ratio):
    H, b = random_quadratic(3)
    settings = AdmmSettings(
        rho=0.05,
        max_iterations=25,
        primal_tolerance=0,
        dual_tolerance=0,
        balance_ratio=balance_ratio,
    )
    centres = []

    def z_step(v, rho, start):
        centres.append((v, rho))
        return np.clip(v, -0.3, 0.3)

    result = solve_admm(
        quadratic_solver(H, b), z_step, np.full(4, 0.1), -np.ones(4), np.ones(4), settings
    )
    assert result.iterations == 25
    y, z = np.zeros(4), np.full(4, 0.1)
    for k in range(25):
        q_k, z_k, rho = result.q_history[k], result.z_history[k], result.rhos[k]
        np.testing.assert_allclose(
            q_k, np.clip(quadratic_solver(H, b)(z - y / rho, rho, None), -1, 1), atol=1e-12
        )
        np.testing.assert_allclose(centres[k][0], q_k + y / rho, atol=1e-9)
        assert centres[k][1] == rho
        assert result.primal_residuals[k] == pytest.approx(np.sqrt(((q_k - z_k) ** 2).sum()))
        assert result.dual_residuals[k] == pytest.approx(rho * np.sqrt(((z_k - z) ** 2).sum()))
        y, z = y + rho * (q_k - z_k), z_k
    np.testing.assert_allclose(result.y, y, atol=1e-12)
    primal, dual = result.recomputed_residuals()
    np.testing.assert_allclose(primal, result.primal_residuals, atol=1e-14)
    np.testing.assert_allclose(dual, result.dual_residuals, atol=1e-14)
    assert (len(set(result.rhos)) > 1) == (balance_ratio > 0)


def test_balancing_helps_a_badly_chosen_rho():
    H, b = random_quadratic(4)
    wide = np.full(4, 100.0)

    def iterations(balance_ratio):
        settings = AdmmSettings(
            rho=1e3,
            max_iterations=3000,
            primal_tolerance=1e-6,
            dual_tolerance=1e-6,
            balance_ratio=balance_ratio,
        )
        result = solve_admm(
            quadratic_solver(H, b), clip_solver(-0.4, 0.4), np.zeros(4), -wide, wide, settings
        )
        assert result.converged
        return result.iterations

    assert iterations(10.0) < iterations(0.0) / 5


def test_not_converging_is_a_status():
    # Disjoint wishes without a box in common: q wants 1, z is held at 0, for ever.
    result = solve_admm(
        constant(1.0, 1.0),
        constant(0.0, 0.0),
        np.zeros(2),
        -np.ones(2),
        np.ones(2),
        AdmmSettings(max_iterations=7),
    )
    assert result.status is AdmmStatus.ITERATION_LIMIT
    assert not result.converged
    assert result.iterations == 7
    np.testing.assert_allclose(result.primal_residuals, np.sqrt(2))
    np.testing.assert_array_equal(result.dual_residuals, 0.0)


def test_solvers_that_find_nothing_better_end_where_they_began():
    def stay(v, rho, start):
        return start

    start = np.array([0.2, 0.7])
    result = solve_admm(stay, stay, start, np.zeros(2), np.ones(2))
    assert result.status is AdmmStatus.CONVERGED
    assert result.iterations == 1
    assert not result.moved
    np.testing.assert_array_equal(result.z, start)
    np.testing.assert_array_equal(result.primal_residuals, 0.0)
    np.testing.assert_array_equal(result.dual_residuals, 0.0)
    assert solve_admm(centre, constant(0.5, 0.5), start, np.zeros(2), np.ones(2)).moved


def test_the_caller_can_stop_it_before_and_between_iterations():
    calls = iter([False, False, True])
    identity = constant(0.5, 0.5)
    half = constant(0.0, 0.0)
    box = (np.zeros(2), -np.ones(2), np.ones(2))
    result = solve_admm(identity, half, *box, should_stop=lambda: next(calls))
    assert result.status is AdmmStatus.STOPPED
    assert result.iterations == 2
    result = solve_admm(identity, half, *box, should_stop=lambda: True)
    assert (result.iterations, result.q.shape, result.q_history.shape) == (0, (2,), (0, 2))
    assert result.recomputed_residuals()[0].shape == (0,)


def test_answers_outside_the_box_are_clipped():
    result = solve_admm(
        constant(9.0, 9.0),
        centre,
        np.full(2, -7.0),
        -np.ones(2),
        np.ones(2),
        AdmmSettings(max_iterations=3),
    )
    np.testing.assert_array_equal(result.z_start, -1.0)
    assert np.all(result.q_history == 1.0)
    assert np.all(np.abs(result.z_history) <= 1.0)


def test_shapes_are_checked():
    with pytest.raises(RequestError, match="one length"):
        solve_admm(centre, centre, [0.0, 0.0], [0.0], [1.0])
