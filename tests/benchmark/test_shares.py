from __future__ import annotations

import math

import numpy as np
import pytest

from gpis_grasp_benchmark.shares import MeanInterval, Share, mcnemar


@pytest.mark.parametrize(
    ("passed", "n", "low", "high"),
    [(24, 25, 0.8046, 0.9929), (0, 10, 0.0, 0.2775), (10, 10, 0.7225, 1.0), (1, 1, 0.2065, 1.0)],
)
def test_wilsons_interval(passed: int, n: int, low: float, high: float) -> None:
    share = Share(passed, n)
    assert share.value == passed / n
    assert share.interval == pytest.approx((low, high), abs=5e-5)


def test_a_share_of_nothing_is_not_known() -> None:
    assert math.isnan(Share.of([]).value)
    assert Share.of([]).interval == (0.0, 1.0)
    assert Share.of([True, False, True]) == Share(2, 3)


def test_the_bootstraps_interval_is_that_of_the_mean(rng: np.random.Generator) -> None:
    values = list(rng.normal(0.4, 0.1, size=400))
    found = MeanInterval.of(values)
    half = 1.96 * np.std(values) / np.sqrt(400)
    assert found.mean == np.mean(values)
    assert (found.low, found.high) == pytest.approx(
        (found.mean - half, found.mean + half), abs=1e-3
    )
    assert MeanInterval.of(values) == found
    assert MeanInterval.of([0.5] * 3) == MeanInterval(0.5, 0.5, 0.5, 3)


def test_mcnemar_counts_the_pairs_that_differ() -> None:
    assert mcnemar([True] * 5 + [False] * 3, [False] * 5 + [False] * 3) == pytest.approx(2 / 32)
    assert mcnemar([True, False], [False, True]) == 1.0
    assert mcnemar([True, True], [True, True]) == 1.0
