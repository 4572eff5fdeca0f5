"""Motions to grasps: what a grasp gets is its own, whichever others come with it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.grasp.hand_motion import hand_motions
from gpis_grasp_planner.hand.drive import joints_from_motors


def closings(hand, start, inner, motor, rng):
    """Arguments of `hand_motions`: motors (B, 3) from start, inner links stopped at `inner`."""
    n = len(start)
    T = transform(Rotation.random(n, rng=rng).as_matrix(), rng.uniform(-0.1, 0.1, (n, 3)))
    spread = rng.uniform(0.0, np.pi, (n, 1))
    opened = joints_from_motors(hand, spread, start, inner[..., None])
    return T, opened, joints_from_motors(hand, spread, motor, inner[..., None]), -0.1 * T[:, :3, 2]


@pytest.fixture
def mixed(planner, rng):
    """Ways with and without breakaway; the last but one is none, the last full travel."""
    n = 12
    start = rng.uniform(0.0, 0.8, (n, 3))
    inner = start + rng.uniform(0.0, 0.9, (n, 3))
    motor = inner + rng.uniform(0.0, 0.3, (n, 3)) * (rng.random((n, 3)) < 0.5)
    inner[-2] = motor[-2] = start[-2]
    start[-1] = 0.0
    inner[-1] = motor[-1] = planner.hand.drive.motor_upper
    return closings(planner.hand, start, inner, motor, rng)


def test_a_motion_is_the_same_alone_and_among_longer_ones(planner, mixed):
    together = hand_motions(planner.hand, *mixed)
    lengths = set()
    for k in range(len(together.T)):
        alone = hand_motions(planner.hand, *(a[k : k + 1] for a in mixed))
        n = alone.T.shape[1]
        np.testing.assert_array_equal(together.T[k, :n], alone.T[0])
        assert (together.T[k, n:] == alone.T[0, -1]).all()
        assert together.moves[k] == alone.moves[0] == n - 1
        assert together.bow[k] == alone.bow[0]
        lengths.add(n)
    assert min(lengths) == 2
    assert len(lengths) > 2


def test_hands_that_have_arrived_are_at_rest_also_where_the_drive_cannot_hold_them(planner, mixed):
    T, opened, closed, back = (np.copy(a) for a in mixed)
    closed[:, [f.distal_joint for f in planner.hand.fingers]] -= 0.01
    together = hand_motions(planner.hand, T, opened, closed, back)
    for k in range(len(T)):
        [alone] = hand_motions(
            planner.hand, T[k : k + 1], opened[k : k + 1], closed[k : k + 1], back[k : k + 1]
        ).T
        np.testing.assert_array_equal(together.T[k, : len(alone)], alone)
        assert (together.T[k, len(alone) :] == alone[-1]).all()


def test_the_bow_is_small_and_none_without_a_motion(planner, mixed):
    bow = hand_motions(planner.hand, *mixed).bow
    assert bow[-2] == 0.0
    assert (bow < 4e-4).all()
