"""Estimates of how likely grasps hold, kept for nearly the same covariance."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.plan import kept_holds
from gpis_grasp_planner.plan.kept_holds import KeptHolds
from gpis_grasp_planner.surroundings.covariance import nearly_equal

C = np.diag([1e-6, 4e-6, 1e-6, 1e-4, 1e-4, 0.0])


def with_entry(i: int, j: int, value: float) -> np.ndarray:
    changed = C.copy()
    changed[i, j] = changed[j, i] = value
    return changed


@pytest.mark.parametrize(
    ("other", "same"),
    [
        (C, True),
        (1.09 * C, True),
        (1.12 * C, False),
        (C / 1.12, False),
        (with_entry(0, 1, 1.9e-7), True),  # a tenth of 1 mm by 2 mm is 2e-7 m^2
        (with_entry(0, 1, 2.1e-7), False),
        (with_entry(5, 5, 1e-12), False),  # what was known exactly is not any more
    ],
)
def test_covariances_are_nearly_equal_by_a_tenth_of_their_variances(other, same):
    assert nearly_equal(C, other) is same
    assert nearly_equal(other, C) is same


def test_an_estimate_is_found_by_its_key_and_covariance():
    kept = KeptHolds()
    kept.put("grasp", C, 0.75)
    assert kept.get("grasp", 1.05 * C) == 0.75
    assert kept.get("grasp", 1.5 * C) is None
    assert kept.get("another", C) is None


def test_small_steps_do_not_lead_away_from_what_was_estimated():
    kept = KeptHolds()
    kept.put("grasp", C, 0.75)
    assert kept.get("grasp", 1.08 * C) == 0.75
    assert kept.get("grasp", 1.16 * C) is None


def test_the_least_recently_used_goes(monkeypatch):
    monkeypatch.setattr(kept_holds, "_MOST", 2)
    kept = KeptHolds()
    kept.put("one", C, 0.1)
    kept.put("two", C, 0.2)
    kept.get("one", C)
    kept.put("three", C, 0.3)
    assert [kept.get(name, C) for name in ("one", "two", "three")] == [0.1, None, 0.3]
