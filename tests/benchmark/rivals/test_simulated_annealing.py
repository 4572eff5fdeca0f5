"""The original simulator's annealing: schedule, acceptance and neighbours against the facts."""

import numpy as np
import pytest
from scipy.stats import kstest

from gpis_grasp_benchmark.rivals.simulated_annealing import (
    AnnealingSettings,
    SimulatedAnnealing,
    acceptance_probability,
    neighbour_step,
    temperature,
)
from gpis_grasp_planner.errors import RequestError

SEED = 17


def test_schedule_values():
    k = np.array([0, 1, 256, 30000, 70000])
    expected = [1e6, 1e6 * np.exp(-7), 1e6 * np.exp(-14)]
    np.testing.assert_allclose(temperature(k)[:3], expected, rtol=1e-14)
    # 30000^(1/8) = 3.62768: about 9.4e-6 from the first step, falling slowly.
    assert temperature(30000) == pytest.approx(1e6 * np.exp(-7 * 30000**0.125), rel=1e-14)
    assert 9e-6 < temperature(30000) < 1e-5
    assert np.all(np.diff(temperature(k)) < 0)
    assert SimulatedAnnealing([0.0], [1.0]).temperature == temperature(30000)


def test_neighbour_steps_have_the_printed_form_and_limits():
    v = np.linspace(-1, 1, 201)
    for T in (1e-9, 1e-5, 0.1, 10.0):
        step = neighbour_step(v, T)
        np.testing.assert_allclose(
            step, np.sign(v) * T * ((1 + 1 / T) ** np.abs(v) - 1), rtol=1e-6, atol=1e-15
        )
        np.testing.assert_allclose(step, -step[::-1], atol=1e-15)
        assert np.all(np.diff(step) > 0)
        assert step[-1] == pytest.approx(1.0)
    # Hot: uniform over the range. Cold: log-uniform above T.
    np.testing.assert_allclose(neighbour_step(v, 1e6), v, atol=1e-6)
    cold = neighbour_step(np.array([0.25, 0.5, 0.75]), 1e-8)
    np.testing.assert_allclose(np.log10(cold), [-6, -4, -2], atol=5e-3)


def test_acceptance_values():
    assert acceptance_probability(1.0, 1.0, 1e-5) == 1.0
    assert acceptance_probability(1.0, -5.0, 1e-5) == 1.0
    assert acceptance_probability(0.0, 10.0, 1e-5) == pytest.approx(np.exp(-1.0))
    assert acceptance_probability(2.0, 2.0 + 9.4, 9.4e-6) == pytest.approx(np.exp(-1.0))
    assert acceptance_probability(0.0, 3.0, 2.0, scale=1.0) == pytest.approx(np.exp(-1.5))


def test_acceptance_statistics_of_the_walk():
    settings = AnnealingSettings(cooling_rate=0.0, initial_temperature=1e-5)  # T constant
    annealer = SimulatedAnnealing([0.0], [1.0], settings=settings, seed=SEED)
    annealer.ask()
    annealer.tell(0.0)
    n, accepted = 4000, 0
    for _ in range(n):
        annealer.ask()
        accepted += annealer.tell(annealer.energy + 7.0)
    expected = np.exp(-0.7)
    print(f"seed {SEED}: accepted {accepted / n:.4f}, expected {expected:.4f}")
    assert abs(accepted / n - expected) < 4 * np.sqrt(expected * (1 - expected) / n)


def test_neighbours_of_the_middle_follow_the_distribution():
    annealer = SimulatedAnnealing([-2.0, 0.0], [2.0, 10.0], start=[0.0, 5.0], seed=SEED)
    T = annealer.temperature
    Y = np.array([annealer.neighbour([0.0, 5.0]) for _ in range(4000)])
    relative = (Y - [0.0, 5.0]) / [4.0, 10.0]
    assert np.all(np.abs(relative) <= 0.5)
    # The inverse of the step gives back |v|, uniform up to the value that reaches the bound.
    v = np.log1p(np.abs(relative) / T) / np.log1p(1 / T)
    limit = np.log1p(0.5 / T) / np.log1p(1 / T)
    for j in range(2):
        assert kstest(v[:, j] / limit, "uniform").pvalue > 1e-3
        assert abs((relative[:, j] > 0).mean() - 0.5) < 0.035
    assert abs(np.corrcoef(v.T)[0, 1]) < 0.06


def test_a_bound_draws_again_and_an_angle_wraps():
    annealer = SimulatedAnnealing(
        [0.0, 0.0], [1.0, 2 * np.pi], periodic=[False, True], start=[0.0, 0.0], seed=SEED
    )
    Y = np.array([annealer.neighbour([0.0, 0.0]) for _ in range(2000)])
    assert Y.min() >= 0
    assert np.all(Y.max(axis=0) <= [1.0, 2 * np.pi])
    assert np.all(Y[:, 0] > 0)
    assert abs((Y[:, 1] > np.pi).mean() - 0.5) < 0.05


@pytest.mark.parametrize("seed", range(4))
def test_the_minimum_of_a_simple_energy_is_found(seed):
    goal = np.array([1.5, -0.5, 3.0])
    annealer = SimulatedAnnealing(
        [-5.0] * 2 + [-np.pi], [5.0] * 2 + [np.pi], periodic=[False, False, True], seed=seed
    )
    for _ in range(4000):
        x = annealer.ask()
        turn = abs(x[2] - goal[2])
        distance = np.hypot(np.linalg.norm(x[:2] - goal[:2]), min(turn, 2 * np.pi - turn))
        annealer.tell(100.0 * distance)
    print(f"seed {seed}: lowest energy {annealer.best_energy:.3f}")
    assert annealer.best_energy < 25.0
    assert annealer.step == 30000 + 4000


def test_the_first_question_is_the_start_and_the_best_is_kept():
    annealer = SimulatedAnnealing([-1.0], [1.0], start=[0.25], seed=SEED)
    np.testing.assert_array_equal(annealer.ask(), [0.25])
    assert annealer.tell(3.0)
    energies = [3.0]
    for _ in range(200):
        x = annealer.ask()
        energies.append(float(np.abs(x[0])))
        annealer.tell(energies[-1])
    assert annealer.best_energy == min(energies)
    assert abs(annealer.best_state[0]) == annealer.best_energy


def test_illegal_states_are_refused_and_do_not_cool():
    annealer = SimulatedAnnealing([-1.0], [1.0], start=[0.5], seed=SEED)
    annealer.ask()
    assert not annealer.tell(np.inf)
    assert annealer.step == 30000
    # The start was illegal: the walk goes on from it until a state has an energy.
    x = annealer.ask()
    assert annealer.tell(1.0)
    np.testing.assert_array_equal(annealer.state, x)
    annealer.ask()
    assert not annealer.tell(np.inf)
    np.testing.assert_array_equal(annealer.state, x)
    assert annealer.step == 30001


def test_a_walk_is_fixed_by_its_seed():
    def walk(seed):
        annealer = SimulatedAnnealing([-1.0] * 3, [1.0] * 3, seed=seed)
        for _ in range(50):
            annealer.tell(float((annealer.ask() ** 2).sum()))
        return annealer.state

    np.testing.assert_array_equal(walk(3), walk(3))
    assert not np.array_equal(walk(3), walk(4))


def test_misuse_is_answered():
    with pytest.raises(RequestError, match="below its upper"):
        SimulatedAnnealing([1.0], [0.0])
    annealer = SimulatedAnnealing([0.0], [1.0])
    with pytest.raises(RequestError, match="call ask first"):
        annealer.tell(1.0)
    annealer.ask()
    with pytest.raises(RequestError, match="NaN"):
        annealer.tell(np.nan)
