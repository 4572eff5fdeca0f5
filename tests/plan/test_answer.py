"""What an answer says where there is no grasp."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.grasp.funnel import Funnel
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.plan.answer import nothing_found


@pytest.mark.parametrize(
    ("name", "pads", "hinted"),
    [
        ("parallel_jaw", False, True),
        ("parallel_jaw", True, False),
        ("barrett_bh280", False, False),
    ],
)
def test_two_fingers_without_pads_are_told_of_them(name, pads, hinted, catalogue):
    hand = replace(load_hand(name), contact_patches=pads)
    code, text = nothing_found(catalogue.load("mug"), hand, 40, Funnel(), 0)
    assert code == ErrorCode.NO_FEASIBLE_GRASP
    assert "40 attempts" in text
    assert ("contact_patches: true" in text) == hinted
