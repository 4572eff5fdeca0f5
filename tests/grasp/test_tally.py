"""What is tallied are proposals, losses by cause, and some of the palms that were lost."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gpis_grasp_planner.grasp.evaluator import Attempts, AttemptStatus
from gpis_grasp_planner.grasp.funnel import Loss, Step
from gpis_grasp_planner.grasp.tally import Tally


def numbered_poses(n):
    """Poses (n, 4, 4) whose x is their number."""
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, 0, 3] = np.arange(n)
    return T


@given(st.lists(st.tuples(st.sampled_from(list(AttemptStatus)), st.integers(0, 3), st.booleans())))
def test_what_is_tallied_are_the_attempts_with_force_closure(made):
    """For any statuses; blocked ones are counted by whoever blocked them, untried ones never."""
    n = len(made)
    attempts = Attempts(
        T_object_palm=numbered_poses(n),
        preshape=np.zeros((n, 1)),
        status=np.array([status for status, _, _ in made], dtype=np.int64),
        joints=np.zeros((n, 8)),
        n_contacts=np.array([k for _, k, _ in made], dtype=np.int64),
        positions=np.zeros((n, 3, 3)),
        normals_inward=np.zeros((n, 3, 3)),
        friction=np.zeros((n, 3)),
        links=np.zeros((n, 3), dtype=np.int64),
        epsilon=np.array([0.1 if good else -1.0 for _, _, good in made]),
        volume=np.zeros(n),
    )
    tally = Tally()
    tally.propose(attempts)
    blocked = sum(status is AttemptStatus.BLOCKED for status, _, _ in made)
    tally.lose(Step.CLEAR, "finger", blocked)
    good = sum(status is AttemptStatus.GRASPED and good for status, _, good in made)
    assert tally.proposed == sum(status is not AttemptStatus.NOT_TRIED for status, _, _ in made)
    funnel = tally.funnel(Step.CLEAR)
    assert funnel.left(Step.CLEAR) == good
    assert funnel.blocked == ({"finger": blocked} if blocked else {})
    # Of what few were lost every palm is kept, and under its own cause.
    kept = tally.lost_palms.positions
    assert {key: len(rows) for key, rows in kept.items()} == {
        key: n for key, n in tally.lost.items() if key != (Step.CLEAR, "finger")
    }
    numbers = [int(x) for rows in kept.values() for x in rows[:, 0]]
    assert len(set(numbers)) == len(numbers)
    for x in tally.lost_palms.positions.get((Step.PALM_FREE, str(Loss.PALM)), np.empty((0, 3))):
        assert made[int(x[0])][0] is AttemptStatus.PALM_COLLISION


def test_palms_without_a_free_place_are_proposals_that_were_lost():
    tally = Tally()
    tally.reject(numbered_poses(3), np.array([True, False, False]))
    assert tally.funnel(Step.CLEAR).table[:2] == (
        (Step.PROPOSED, 2, {}),
        (Step.PALM_FREE, 0, {str(Loss.DEEP): 2}),
    )
    [rows] = tally.lost_palms.positions.values()
    np.testing.assert_array_equal(rows, [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])


def test_a_copy_is_counted_on_apart():
    tally = Tally()
    tally.take_over(5)
    tally.lose(Step.CLOSED, Loss.ITSELF, 2)
    copy = tally.copy()
    copy.lose(Step.CLOSED, Loss.ITSELF, 3)
    assert tally.funnel(Step.HELD).left(Step.HELD) == 3
    assert copy.funnel(Step.HELD).left(Step.HELD) == 0
