"""What is drawn of a pre-shape: up to the motors' ends, and to the setting where it turns."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.preshape import SLIDING_LEVER_M
from gpis_grasp_planner.search.preshape_range import PreshapeRange


@pytest.mark.parametrize(("max_deg", "upper_deg"), [(180.0, 180.0), (40.0, 40.0), (0.0, 0.0)])
def test_a_motor_that_turns_is_drawn_up_to_the_setting(
    max_deg: float, upper_deg: float, rng: np.random.Generator
) -> None:
    within = PreshapeRange.of(load_hand(), max_deg)
    assert np.rad2deg(within.upper) == pytest.approx([upper_deg])
    drawn = np.rad2deg(within.draw(2000, rng))
    assert (drawn >= 0.0).all()
    assert (drawn <= upper_deg).all()
    if upper_deg:  # even: no tenth of the range is empty
        assert len(np.unique((drawn * 10.0 / upper_deg).astype(int).clip(0, 9))) == 10


def test_a_motor_that_slides_is_drawn_up_to_its_end() -> None:
    turning = load_hand().preshape
    long = dataclasses.replace(
        turning, lower=np.array([0.01]), upper=np.array([0.3]), unit=np.array([SLIDING_LEVER_M])
    )
    hand = SimpleNamespace(preshape=long)
    for max_deg in (0.0, 40.0, 180.0):
        within = PreshapeRange.of(hand, max_deg)
        np.testing.assert_array_equal([within.lower, within.upper], [[0.01], [0.3]])
