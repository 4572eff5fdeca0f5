"""Objectives: the paper's formula, measures of either sense, columns and single grasps alike."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from gpis_grasp_planner.quality.balance_factor import balance_factor
from gpis_grasp_planner.quality.figures import Figure, Quality
from gpis_grasp_planner.quality.measure import Measure
from gpis_grasp_planner.quality.objective import EpsilonVolume, OneMeasure, worth


@dataclass
class Columns:
    """Figures of many, as attempts have them."""

    epsilon: np.ndarray
    volume: np.ndarray
    imbalance: np.ndarray | None = None
    measured: dict[str, np.ndarray] = field(default_factory=dict)


def measure(larger: bool) -> Measure:
    return Measure(Figure("m", "", larger, "", ""), lambda held: 0.0)


def test_the_papers_formula() -> None:
    many = Columns(np.array([0.2, -1.0]), np.array([0.1, 0.4]))
    np.testing.assert_array_equal(EpsilonVolume(0.5).value(many), [0.25, 0.2])
    assert EpsilonVolume(0.5).text == "epsilon + 0.5 volume"
    assert EpsilonVolume(0.5).measures == ()


@pytest.mark.parametrize("larger", [True, False])
def test_a_better_figure_is_worth_more_and_no_grasp_nothing(larger: bool) -> None:
    objective = OneMeasure(measure(larger))
    m = np.array([0.1, 0.5, 2.0, np.nan, np.inf, 0.5])
    epsilon = np.array([0.1, 0.1, 0.1, 0.1, 0.1, -1.0])
    values = objective.value(Columns(epsilon, np.ones(6), None, {"m": m}))
    assert (np.diff(values[:3]) > 0.0).all() == larger
    assert (values[:3] > 0.0).all()
    np.testing.assert_array_equal(values[3:], 0.0)
    for i in (0, 1, 2, 5):
        one = Quality(epsilon[i], 1.0, None, {"m": m[i]})
        assert float(objective.value(one)) == values[i]
    assert float(objective.value(Quality(0.1, 1.0))) == 0.0  # not measured


def test_what_is_unbalanced_is_worth_less_by_any_objective() -> None:
    for objective in (EpsilonVolume(0.5), OneMeasure(measure(True))):
        even = Quality(0.2, 0.1, 0.0, {"m": 0.4})
        uneven = Quality(0.2, 0.1, 0.6, {"m": 0.4})
        ratio = float(worth(objective, uneven)) / float(worth(objective, even))
        assert ratio == pytest.approx(float(balance_factor(0.6)), rel=1e-14)
