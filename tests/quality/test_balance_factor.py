"""What an imbalance costs."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.quality.balance_factor import balance_factor


def test_the_factor_falls_from_one_to_its_floor() -> None:
    values = balance_factor(np.array([0.0, 0.2, 1.0, 1e9]))
    assert values[0] == 1.0
    assert values[1] == pytest.approx(0.15 + 0.85 / 2)
    assert values[3] == pytest.approx(0.15)
    assert (np.diff(values) < 0.0).all()
