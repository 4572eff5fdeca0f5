"""Every loss has its advice, and nothing lost needs none."""

from __future__ import annotations

import pytest

from gpis_grasp_planner.grasp.funnel import Funnel, Loss, Step
from gpis_grasp_planner.plan.funnel_advice import advice


@pytest.mark.parametrize(
    ("step", "cause"),
    [
        *((Step.CONFIRMED, str(loss)) for loss in Loss),
        (Step.PALM_FREE, "support"),
        (Step.CLEAR, "finger"),
        (Step.HELD, "slipped"),
    ],
)
def test_each_loss_is_told_with_what_can_be_done(step, cause):
    text = advice(Funnel(3, {(step, cause): 3}, Step.HELD))
    assert any(word in text for word in ("Give more time", "give more time", "Check", "Move"))
    assert text.endswith(".")
    if cause not in set(Loss):
        assert f"'{cause}'" in text


def test_nothing_lost_needs_no_advice():
    assert advice(Funnel(3, {}, Step.HELD)) == ""
