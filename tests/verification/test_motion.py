"""When a push is over: known courses of slip and turn over time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gpis_grasp_planner.verification.motion import Motion, PushWatch
from gpis_grasp_planner.verification.settings import VerificationSettings

SETTINGS = VerificationSettings()
TURN_LIMIT = np.radians(SETTINGS.rotation_limit_deg)


def watched(course: Callable[[float], Motion]) -> PushWatch:
    """A push in which the part moves by a function of time."""
    watch = PushWatch(SETTINGS)
    while not watch.over:
        step_s = watch.next_s
        watch.see(step_s, course(watch.elapsed_s + step_s))
    return watch


def creeping(slip_m: float, turn_rad: float) -> Callable[[float], Motion]:
    """A steady drift that comes to a slip and a turn at the end of the push."""
    return lambda t: Motion(slip_m * t / SETTINGS.duration_s, turn_rad * t / SETTINGS.duration_s)


def test_limits_are_those_of_the_protocol() -> None:
    assert Motion(0.0299, 0.99 * TURN_LIMIT).within(SETTINGS)
    assert not Motion(0.03, 0.0).within(SETTINGS)
    assert not Motion(0.0, TURN_LIMIT).within(SETTINGS)
    assert not Motion(0.016, 0.0).within(SETTINGS, 0.5)
    assert not Motion(float("nan"), 0.0).within(SETTINGS)


def test_a_part_at_rest_is_seen_at_once() -> None:
    watch = watched(lambda t: Motion(0.0, 0.0))
    assert watch.held
    assert watch.elapsed_s == pytest.approx(0.1)
    assert watch.largest == Motion(0.0, 0.0)


def test_a_part_that_comes_to_rest_elsewhere_is_held() -> None:
    """It turns by 13 degrees within 0.2 s and stays there: nothing more will be seen."""
    turned = np.radians(13.0)
    watch = watched(lambda t: Motion(0.0, turned * min(t / 0.2, 1.0)))
    assert watch.held
    assert watch.elapsed_s == pytest.approx(0.5)  # it has to rest for 0.3 s, having come so far
    assert watch.largest.rotation_rad == pytest.approx(turned)


@pytest.mark.parametrize("share", [0.06, 0.5, 0.99])
def test_a_drift_that_may_matter_is_watched_to_the_end(share: float) -> None:
    for slip, turn in ((share * SETTINGS.slip_limit_m, 0.0), (0.0, share * TURN_LIMIT)):
        watch = watched(creeping(slip, turn))
        assert watch.held
        # taken twice, 6 % come below a tenth only when little time is left
        assert watch.elapsed_s > 0.1 + 1e-9
        assert watch.largest.slip_m >= slip - 1e-12
        assert watch.largest.rotation_rad >= turn - 1e-12


def test_a_slow_drift_is_answered_with_what_it_may_become() -> None:
    slip = 0.04 * SETTINGS.slip_limit_m
    watch = watched(creeping(slip, 0.0))
    assert watch.held
    assert watch.elapsed_s == pytest.approx(0.1)
    # 0.1 s were seen, the other 1.9 s count twice
    assert watch.largest.slip_m == pytest.approx(slip * (0.1 + 2 * 1.9) / 2.0)


def test_a_drift_beyond_the_limits_is_a_loss() -> None:
    watch = watched(creeping(0.0, 1.2 * TURN_LIMIT))
    assert not watch.held
    assert watch.elapsed_s == pytest.approx(1.7)


def test_near_the_limit_the_expected_drift_decides_nothing() -> None:
    """A rest at 97 % of the limit with a drift that could go beyond it is watched on."""
    start, end = 0.97 * TURN_LIMIT, 0.995 * TURN_LIMIT
    watch = watched(lambda t: Motion(0.0, start + (end - start) * t / SETTINGS.duration_s))
    assert watch.held
    assert watch.elapsed_s > 0.7
    beyond = watched(lambda t: Motion(0.0, start + 1.4 * (TURN_LIMIT - start) * t / 2.0))
    assert not beyond.held


def test_a_part_that_breaks_away_late_is_seen_while_it_still_moves() -> None:
    """A creep of 2 mm/s that turns into sliding after a second."""
    watch = watched(lambda t: Motion(0.002 * t + 0.1 * max(0.0, t - 1.0) ** 2, 0.0))
    assert not watch.held
    assert watch.elapsed_s == pytest.approx(1.55)  # 3.1 mm and 30 mm


def test_a_simulation_that_breaks_down_holds_nothing() -> None:
    watch = watched(lambda t: Motion(float("nan"), 0.0))
    assert watch.over
    assert not watch.held


def test_a_part_that_moved_and_paused_is_not_taken_for_held() -> None:
    """It slips by 4 mm, rests for 0.2 s, and breaks away."""
    watch = watched(lambda t: Motion(0.004 * min(t / 0.1, 1.0) + 0.2 * max(0.0, t - 0.3), 0.0))
    assert not watch.held
    still = watched(lambda t: Motion(0.002 * min(t / 0.05, 1.0), 0.0))
    assert still.held
    assert still.elapsed_s == pytest.approx(0.1)
