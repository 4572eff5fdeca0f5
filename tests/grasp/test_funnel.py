"""The funnel adds up by construction: every step is the one before less its own losses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpis_grasp_planner.grasp.evaluator import Attempts, AttemptStatus
from gpis_grasp_planner.grasp.funnel import Funnel, Loss, Step, Tally

LOSSES = st.dictionaries(
    st.tuples(st.sampled_from(list(Step)[1:]), st.sampled_from(("a", "b", *Loss))),
    st.integers(1, 50),
    max_size=20,
)


@given(lost=LOSSES, kept=st.integers(0, 50))
def test_each_step_is_the_one_before_less_its_causes(lost, kept):
    funnel = Funnel(sum(lost.values()) + kept, lost, Step.HELD)
    before = funnel.proposed
    for _, left, causes in funnel.table:
        assert left == before - sum(causes.values())
        assert 0 <= left <= before
        assert list(causes.values()) == sorted(causes.values(), reverse=True)
        before = left
    assert before == kept
    assert Funnel.of_table(funnel.table) == funnel


@given(lost=LOSSES, kept=st.integers(0, 50))
def test_the_main_loss_is_the_narrowest_step(lost, kept):
    funnel = Funnel(sum(lost.values()) + kept, lost, Step.HELD)
    passed = {
        step: funnel.left(step) / funnel.left(before)
        for before, step in zip(funnel.steps, funnel.steps[1:], strict=False)
        if funnel.left(before)
    }
    main = funnel.main_loss
    counted = {
        step: share
        for step, share in passed.items()
        if share < 1.0 and (share == 0.0 or step not in (Step.DISTINCT, Step.TRIED))
    }
    if main is None:
        assert not counted
    else:
        assert passed[main[0]] == min(counted.values())
        assert lost[main] == max(funnel.causes(main[0]).values())


@pytest.mark.parametrize(
    ("proposed", "lost", "last"),
    [
        (3, {(Step.CLOSED, "a"): 4}, Step.HELD),
        (3, {(Step.CLOSED, "a"): 0}, Step.HELD),
        (3, {(Step.CLOSED, "a"): -1}, Step.HELD),
        (3, {(Step.PROPOSED, "a"): 1}, Step.HELD),
        (3, {(Step.HELD, "a"): 1}, Step.CONFIRMED),
    ],
)
def test_what_cannot_be_is_refused(proposed, lost, last):
    with pytest.raises(ValueError, match=r"lost|Losses"):
        Funnel(proposed, lost, last)


@pytest.mark.parametrize(
    ("rows", "word"),
    [
        ([], "steps are"),
        ([("closed", 3, {})], "steps are"),
        ([("proposed", 3, {}), ("closed", 3, {})], "steps are"),
        ([("proposed", 3, {}), ("palm free", 3, {"a": 1})], "2 are left"),
    ],
)
def test_a_table_that_does_not_add_up_is_refused(rows, word):
    with pytest.raises(ValueError, match=word):
        Funnel.of_table(rows)


@given(st.lists(st.tuples(st.sampled_from(list(AttemptStatus)), st.integers(0, 3), st.booleans())))
def test_what_is_tallied_are_the_attempts_with_force_closure(made):
    """For any statuses; blocked ones are counted by whoever blocked them, untried ones never."""
    n = len(made)
    attempts = Attempts(
        T_object_palm=np.tile(np.eye(4), (n, 1, 1)),
        spread=np.zeros(n),
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


def test_palms_without_a_free_place_are_proposals_that_were_lost():
    tally = Tally()
    tally.reject(np.array([True, False, False]))
    assert tally.funnel(Step.CLEAR).table[:2] == (
        (Step.PROPOSED, 2, {}),
        (Step.PALM_FREE, 0, {str(Loss.DEEP): 2}),
    )
