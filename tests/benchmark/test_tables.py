from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from gpis_grasp_benchmark.tables import (
    Estimate,
    best,
    best_epsilon_at,
    mean_of_best,
    mean_over_objects,
    ratio,
    summarise,
)


def test_missing_grasps_count_as_zero(make_record) -> None:
    record = make_record([0.1, 0.06, 0.04])
    assert mean_of_best(record, "epsilon") == pytest.approx(0.2 / 20)
    assert mean_of_best(make_record([]), "epsilon") == 0.0


def test_the_best_has_the_largest_epsilon_and_its_own_volume(make_record) -> None:
    record = make_record([0.05, 0.08, 0.07], [0.3, 0.1, 0.2])
    assert best(record, "epsilon") == 0.08
    assert best(record, "volume") == 0.1
    assert best(make_record([]), "volume") == 0.0


def test_the_interval_is_that_of_students_t(rng: np.random.Generator) -> None:
    values = list(rng.normal(1.0, 0.3, 7))
    estimate = Estimate.of(values)
    low, high = stats.t.interval(0.95, 6, np.mean(values), stats.sem(values))
    assert estimate.mean - estimate.half_width == pytest.approx(low, rel=1e-12)
    assert estimate.mean + estimate.half_width == pytest.approx(high, rel=1e-12)


def test_the_interval_covers_the_mean_as_often_as_it_says(rng: np.random.Generator) -> None:
    estimates = [Estimate.of(list(rng.normal(0.05, 0.02, 5))) for _ in range(2000)]
    covered = np.mean([abs(e.mean - 0.05) <= e.half_width for e in estimates])
    assert 0.93 < covered < 0.97  # 4 standard deviations of the share


def test_one_seed_has_no_interval() -> None:
    estimate = Estimate.of([0.1])
    assert (estimate.mean, estimate.n) == (0.1, 1)
    assert math.isnan(estimate.half_width)


def test_summaries_are_per_object_and_planner_over_seeds(make_record) -> None:
    records = [
        make_record([0.1] * 20, seed=0),
        make_record([0.2] * 20, seed=1),
        make_record([], seed=0, planner="random"),
        make_record([0.04], seed=1, planner="random"),
        make_record([0.3] * 10, object_id="flask"),
    ]
    mug, by_chance, flask = summarise(records)
    assert (mug.object_id, mug.planner, mug.seeds, mug.successes) == ("mug", "hpp", 2, 2)
    assert mug.mean_epsilon.mean == pytest.approx(0.15)
    assert mug.best_epsilon.mean == pytest.approx(0.15)
    assert mug.best_epsilon_of_any_seed == 0.2
    assert mug.evaluations_per_s.mean == pytest.approx(250.0)
    assert (by_chance.planner, by_chance.successes, by_chance.found.mean) == ("random", 1, 0.5)
    assert by_chance.mean_epsilon.mean == pytest.approx(0.001)
    assert flask.mean_epsilon.mean == pytest.approx(0.15)
    assert mean_over_objects([mug, by_chance, flask], "hpp", "epsilon") == pytest.approx(0.15)
    assert math.isnan(mean_over_objects([mug], "random", "epsilon"))


@pytest.mark.parametrize(
    ("value", "to", "expected"), [(3.0, 2.0, 1.5), (1.0, 0.0, math.inf), (0.0, 2.0, 0.0)]
)
def test_ratio(value: float, to: float, expected: float) -> None:
    assert ratio(value, to) == expected


def test_nothing_over_nothing_is_no_ratio() -> None:
    assert math.isnan(ratio(0.0, 0.0))


def test_the_best_so_far_is_a_step_function(make_record) -> None:
    record = make_record([0.08])  # improved at 1 s to 0.01 and at 4 s to 0.08
    assert best_epsilon_at(record, [0.0, 0.99, 1.0, 3.9, 4.0, 20.0]) == [
        0.0,
        0.0,
        0.01,
        0.01,
        0.08,
        0.08,
    ]
    assert best_epsilon_at({"convergence": []}, [0.0, 5.0]) == [0.0, 0.0]
