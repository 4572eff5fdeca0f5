"""A quality's named figures."""

from __future__ import annotations

from gpis_grasp_planner.quality.figures import ALWAYS, EPSILON, Figure, Quality, named


def test_all_that_is_known_by_name() -> None:
    assert Quality(0.1, 0.02).figures == {"epsilon": 0.1, "volume": 0.02}
    full = Quality(0.1, 0.02, 0.3, {"min_weight": 0.4})
    assert full.figures == {"epsilon": 0.1, "volume": 0.02, "imbalance": 0.3, "min_weight": 0.4}
    assert full.force_closure
    assert not Quality(-1.0, 0.5).force_closure


def test_the_first_of_a_name_counts() -> None:
    other = Figure("epsilon", "m", False, "", "")
    assert named([*ALWAYS, other])["epsilon"] is EPSILON
