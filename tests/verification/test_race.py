"""The race: who is tried next, and that trials go to the grasps that matter."""

from collections.abc import Sequence

import numpy as np
import pytest

from gpis_grasp_planner.verification.hold_model import BetaPosterior
from gpis_grasp_planner.verification.race import Arm, next_arm

N_CASES = 13


def arm(passed: int, failed: int, n_left: int = 5, busy: bool = False) -> Arm:
    return Arm(BetaPosterior(1.0 + passed, 1.0 + failed), passed + failed, n_left, busy)


def test_the_highest_bound_and_those_not_tried_in_turn() -> None:
    arms = [arm(1, 3), arm(6, 1), arm(1, 1), arm(0, 0)]
    assert next_arm(arms, 0) == 1
    assert next_arm(arms, 1) == 3
    assert next_arm(arms[:3], 1) == 1  # all were tried
    few, many = arm(1, 0), arm(2, 1)
    assert few.posterior.mean > many.posterior.mean
    assert next_arm([arm(4, 2), few], 0) == 1  # equal means: the one of which less is known
    assert arm(4, 2).posterior.mean == pytest.approx(0.625)


def test_of_equals_the_first() -> None:
    arms = [arm(0, 0), arm(0, 0), arm(0, 0)]
    assert [next_arm(arms, turn) for turn in (0, 1)] == [0, 0]


def test_who_cannot_be_tried_is_passed_over() -> None:
    arms = [arm(9, 0, busy=True), arm(5, 0, n_left=0), arm(0, 5), arm(0, 4)]
    assert next_arm(arms, 0) == 3
    assert next_arm(arms, 1) == 3
    assert next_arm([arm(0, 0, n_left=0), arm(0, 5)], 1) == 1
    assert next_arm([arm(9, 0, n_left=0), arm(2, 2, busy=True)], 0) is None
    assert next_arm([], 0) is None


def chosen_after(drawn: np.ndarray, n_trials: int, *, race: bool) -> int:
    """The arm with the highest mean after so many trials, raced or shared out evenly."""
    made = [0] * len(drawn)

    def posterior(i: int) -> BetaPosterior:
        passed = drawn[i, : made[i]].sum()
        return BetaPosterior(1.5 + passed, 0.5 + made[i] - passed)

    for turn in range(n_trials):
        arms = [Arm(posterior(i), made[i], N_CASES - made[i]) for i in range(len(drawn))]
        chosen = next_arm(arms, turn) if race else turn % len(drawn)
        assert chosen is not None
        made[chosen] += 1
    return max(range(len(drawn)), key=lambda i: posterior(i).mean)


def losses(n_arms: int, n_trials: int, seeds: Sequence[int], *, race: bool) -> float:
    """Mean over seeded races: what the chosen arm holds less often than the best one."""
    lost = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        truth = rng.beta(2.0, 1.0, n_arms)
        drawn = rng.random((n_arms, N_CASES)) < truth[:, None]
        lost.append(truth.max() - truth[chosen_after(drawn, n_trials, race=race)])
    return float(np.mean(lost))


@pytest.mark.parametrize(("n_arms", "n_trials"), [(8, 30), (20, 60)])
def test_a_race_loses_half_of_what_even_trials_lose(n_arms: int, n_trials: int, seed: int) -> None:
    seeds = range(seed, seed + 150)
    raced = losses(n_arms, n_trials, seeds, race=True)
    even = losses(n_arms, n_trials, seeds, race=False)
    print(f"seed {seed}: raced {raced:.3f}, even {even:.3f}")
    assert raced < 0.6 * even
