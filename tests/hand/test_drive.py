"""Coupling, breakaway, and limits with values worked out by hand from the gear ratios."""

import numpy as np
import pytest
from scipy.optimize import linprog

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.drive import (
    joints_from_motors,
    motors_from_joints,
    reachable,
)
from gpis_grasp_planner.hand.drive_train import _farthest, check_limits, rounded_limits


def degrees(spread, motor, stop=np.inf):
    """Joint angles [deg] for one posture given in degrees."""
    hand = load_hand()
    stop = np.radians(np.asarray(stop, dtype=float))
    q = joints_from_motors(hand, np.radians([[spread]]), np.radians([motor]), stop[..., None])
    return np.degrees(q[0])


def test_before_breakaway_the_distal_joint_turns_a_third_of_the_inner():
    found = degrees(30.0, [90.0, 60.0, 0.0])
    np.testing.assert_allclose(found, [30, 30, 90, 60, 0, 30, 20, 0], atol=1e-9)


def test_after_breakaway_the_inner_holds_and_the_distal_goes_on_four_thirds():
    # Stopped at 45 deg, where the distal joint is at 15; 6 deg more of motor are 8 of the joint.
    found = degrees(0.0, [51.0, 45.0, 30.0], [45.0, 45.0, 45.0])
    np.testing.assert_allclose(found, [0, 0, 45, 45, 30, 23, 15, 10], atol=1e-9)


def test_the_firmware_law_holds_in_motor_angles():
    motor_deg = 5000.0  # of the motor's shaft: 40 deg at 125:1
    stop = 24.0
    expected = motor_deg * (1 / 125 + 1 / 375) - stop
    assert degrees(0.0, [motor_deg / 125] * 3, [stop] * 3)[5] == pytest.approx(expected, abs=1e-9)


def test_angles_are_clipped_to_the_limits():
    found = degrees(200.0, [170.0, -5.0, 100.0], [np.inf, np.inf, 30.0])
    np.testing.assert_allclose(found, [180, 180, 140, 0, 30, 48, 0, 48], atol=1e-9)


def test_motors_and_joints_are_inverse_on_both_sides_of_the_breakaway():
    hand = load_hand()
    seed = 11
    print(f"seed {seed}")
    rng = np.random.default_rng(seed)
    spread = rng.uniform(0.0, np.pi, (200, 1))
    stop = rng.uniform(0.0, np.radians(140.0), (200, 3))
    # (stop + 48) 3/4: where the distal joint ends; a free finger runs to 140.
    end = np.minimum((stop + np.radians(48.0)) * 0.75, np.radians(140.0))
    motor = rng.uniform(0.0, 1.0, (200, 3)) * end
    q = joints_from_motors(hand, spread, motor, stop[..., None])
    spread_back, motor_back = motors_from_joints(hand, q)
    np.testing.assert_allclose(spread_back, spread, atol=1e-12)
    np.testing.assert_allclose(motor_back, motor, atol=1e-12)
    assert reachable(hand, q).all()


def test_what_the_drive_cannot_reach_is_told():
    hand = load_hand()
    good = joints_from_motors(hand, [[0.5]], [[1.0, 1.0, 1.0]])[0]
    behind, apart, beyond = good.copy(), good.copy(), good.copy()
    behind[hand.fingers[1].distal_joint] -= 0.1
    apart[hand.preshape.joints[0]] += 0.1
    beyond[hand.fingers[2].distal_joint] = np.radians(48.1)
    found = reachable(hand, np.stack([good, behind, apart, beyond]))
    np.testing.assert_array_equal(found, [True, False, False, False])


def test_the_motors_have_the_quoted_speeds():
    hand = load_hand()
    np.testing.assert_allclose(hand.drive.motor_speed, 2.44, atol=0.005)
    np.testing.assert_allclose(hand.preshape.speed, 6.28, atol=0.005)


def test_one_row_of_a_closing_table_goes_as_far_as_the_linear_programme_says() -> None:
    rng = np.random.default_rng(5)
    for _ in range(200):
        row = np.array([[1.0, *rng.uniform(0.0, 2.0, 2)]])
        upper, travel = rng.uniform(0.1, 3.0, 3), float(rng.uniform(0.1, 6.0))
        best = linprog(
            -row[:, 2],
            A_ub=np.vstack([row[:, :1].T, row.sum(axis=1)]),
            b_ub=[upper[0], travel],
            bounds=[(0.0, None)],
        )
        assert _farthest(row, upper, travel, 2) == pytest.approx(row[0, 2] * best.x[0], abs=1e-9)


def test_a_limit_that_was_rounded_below_what_the_table_says_is_made_good():
    """0.98175 times 1.3588 is 2e-6 beyond 1.334; 1.3 is another stop, and stays one."""
    table = np.array([[1.0, 1.3588], [0.0, 1.0]])
    limits = rounded_limits(table, np.array([0.98175, 1.334]), 0.98175)
    np.testing.assert_allclose(limits, [0.98175, 0.98175 * 1.3588], rtol=0.0, atol=1e-12)
    check_limits("it", table, limits, 0.98175)
    far = np.array([0.98175, 1.3])
    np.testing.assert_array_equal(rounded_limits(table, far, 0.98175), far)
    with pytest.raises(RequestError, match=r"go to 1.334, but its stop is at 1.3;"):
        check_limits("it", table, far, 0.98175)
