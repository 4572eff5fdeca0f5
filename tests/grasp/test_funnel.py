"""The funnel adds up by construction: every step is the one before less its own losses."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpis_grasp_planner.grasp.funnel import Funnel, Loss, Step

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
