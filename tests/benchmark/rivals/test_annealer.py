"""Steps, schedules and targets of the annealing over hand states."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gpis_grasp_benchmark.rivals.annealer import StateAnnealing
from gpis_grasp_benchmark.rivals.hand_states import Variables
from gpis_grasp_benchmark.rivals.simulated_annealing import AnnealingSettings, temperature

VARIABLES = Variables(
    lower=np.array([-0.25, 0.0, -np.pi, -4.0]),
    upper=np.array([0.25, np.pi, np.pi, 4.0]),
    largest_step=np.array([0.15, np.pi / 5, np.pi / 2, 2.0]),
    periodic=np.array([False, False, True, False]),
)
HOT = AnnealingSettings(initial_temperature=1e3, cooling_rate=0.0, first_step=0)


def change(a, b):
    """Difference of states, the periodic one the short way round."""
    d = b - a
    d[2] = (d[2] + np.pi) % (2 * np.pi) - np.pi
    return d


def test_neighbours_keep_to_the_ranges_and_to_the_largest_steps(rng):
    walk = StateAnnealing(VARIABLES, rng, acceptance=HOT)
    reached = np.zeros(4)
    for _ in range(3000):
        state = rng.uniform(VARIABLES.lower, VARIABLES.upper)
        neighbour = walk.neighbour(state)
        assert np.all((neighbour >= VARIABLES.lower) & (neighbour <= VARIABLES.upper))
        step = np.abs(change(state, neighbour)) / VARIABLES.largest_step
        assert np.all(step <= 1.0 + 1e-9)
        reached = np.maximum(reached, step)
    assert np.all(reached > 0.95)


def test_cold_steps_are_small(rng):
    cold = AnnealingSettings(initial_temperature=1e-9, cooling_rate=0.0, first_step=0)
    walk = StateAnnealing(VARIABLES, rng, acceptance=cold)
    state = np.zeros(4) + 0.1
    steps = np.array([change(state, walk.neighbour(state)) for _ in range(2000)])
    share = np.abs(steps) / VARIABLES.largest_step
    # log-uniform from the temperature up: the median is the root of 1e-9
    assert_allclose(np.log10(np.median(share, axis=0)), -4.5, atol=0.5)


def test_steps_and_acceptance_cool_at_their_own_rates(rng):
    slow = AnnealingSettings(
        initial_temperature=10.0, cooling_rate=0.22, schedule_dimension=2.0, first_step=0
    )
    fast = AnnealingSettings(
        initial_temperature=10.0, cooling_rate=0.72, schedule_dimension=2.0, first_step=0
    )
    walk = StateAnnealing(VARIABLES, rng, acceptance=slow, steps=fast)
    for _ in range(100):
        walk.ask()
        walk.tell(0.0)
    assert walk.step == 100
    assert walk.temperature == pytest.approx(10.0 * np.exp(-2.2))
    assert walk.step_temperature == pytest.approx(10.0 * np.exp(-7.2))
    assert StateAnnealing(VARIABLES, rng).step_temperature == temperature(30000)


def test_full_confidence_steps_onto_the_target_or_as_far_as_may_be(rng):
    target = np.array([0.1, 1.0, 2.0, -1.0])
    walk = StateAnnealing(VARIABLES, rng, target=target, confidence=np.ones(4))
    near = target + 0.5 * VARIABLES.largest_step
    assert_allclose(walk.neighbour(near), target, atol=1e-12)
    far = np.array([-0.2, 3.0, 2.0, 3.9])
    expected = np.array([-0.05, 3.0 - np.pi / 5, 2.0, 1.9])
    assert_allclose(walk.neighbour(far), expected, atol=1e-12)


def test_steps_are_drawn_towards_the_target(rng):
    target = np.array([0.05, 1.5, 0.5, 1.0])
    start = target - 0.4 * VARIABLES.largest_step
    steps = AnnealingSettings(initial_temperature=0.1, cooling_rate=0.0, first_step=0)
    walk = StateAnnealing(
        VARIABLES, rng, acceptance=steps, target=target, confidence=np.full(4, 0.65)
    )
    free = StateAnnealing(VARIABLES, rng, acceptance=steps)
    drawn = np.mean([walk.neighbour(start) - start for _ in range(4000)], axis=0)
    undrawn = np.mean([free.neighbour(start) - start for _ in range(4000)], axis=0)
    assert np.all(drawn > 0.1 * VARIABLES.largest_step)
    assert np.all(np.abs(undrawn) < 0.05 * VARIABLES.largest_step)


def test_the_schedule_starts_anew_at_its_end_and_goes_on_from_where_it_is(rng):
    walk = StateAnnealing(VARIABLES, rng, last_step=30_005)
    for _ in range(5):
        walk.ask()
        walk.tell(-1.0)
    assert walk.step == 30_000
    assert walk.energy == np.inf
    state = walk.state.copy()
    walk.ask()
    walk.tell(np.inf)
    assert_allclose(walk.state, state)
    asked = walk.ask()
    assert not np.allclose(asked, state, atol=0.0, rtol=0.0)
    assert walk.tell(1e5)
    assert_allclose(walk.state, asked)


def test_the_same_seed_walks_the_same_way():
    def walk(seed):
        annealer = StateAnnealing(VARIABLES, np.random.default_rng(seed))
        states = []
        for _ in range(200):
            x = annealer.ask()
            states.append(x)
            annealer.tell(float(np.sum(x**2)))
        return np.array(states)

    assert_allclose(walk(3), walk(3), rtol=0.0, atol=0.0)
    assert not np.allclose(walk(3), walk(4))
