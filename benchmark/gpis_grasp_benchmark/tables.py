"""From records to the figures of the paper's tables: means over seeds with their intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

CONFIDENCE = 0.95

Record = dict[str, Any]


@dataclass(frozen=True)
class Estimate:
    """A mean over seeds; `half_width` of its 95 % interval (Student's t), NaN for one seed."""

    mean: float
    half_width: float
    n: int

    @staticmethod
    def of(values: Sequence[float]) -> Estimate:
        """Estimate the mean of one value per seed."""
        n = len(values)
        if n < 2:
            return Estimate(float(np.mean(values)) if n else math.nan, math.nan, n)
        spread = float(np.std(values, ddof=1)) / math.sqrt(n)
        quantile = float(student.ppf(0.5 + 0.5 * CONFIDENCE, n - 1))
        return Estimate(float(np.mean(values)), quantile * spread, n)


@dataclass(frozen=True)
class Summary:
    """One object and planner over all seeds.

    `mean_*`: of the `n_grasps` best distinct grasps, missing ones counted as 0, averaged over
    seeds. `best_*`: of the grasp with the largest epsilon in each run, averaged over seeds.
    """

    object_id: str
    planner: str
    n_grasps: int
    mean_epsilon: Estimate
    mean_volume: Estimate
    best_epsilon: Estimate
    best_volume: Estimate
    best_epsilon_of_any_seed: float
    found: Estimate
    successes: int
    evaluations_per_s: Estimate
    n_evaluations: Estimate
    elapsed_s: Estimate

    @property
    def seeds(self) -> int:
        """Number of runs."""
        return self.found.n


def mean_of_best(record: Record, quality: str) -> float:
    """Mean 'epsilon' or 'volume' of a run's best grasps, with 0 for each that is missing."""
    return float(sum(record[quality]) / record["n_grasps"])


def best(record: Record, quality: str) -> float:
    """'epsilon' or 'volume' of the grasp with the largest epsilon; 0 where there is none."""
    if not record["epsilon"]:
        return 0.0
    return float(record[quality][int(np.argmax(record["epsilon"]))])


def summarise(records: Sequence[Record]) -> list[Summary]:
    """One summary per object and planner, in the order of their first records."""
    groups: dict[tuple[str, str], list[Record]] = {}
    for record in records:
        groups.setdefault((record["object_id"], record["planner"]), []).append(record)
    return [_summary(*key, group) for key, group in groups.items()]


def _summary(object_id: str, planner: str, runs: list[Record]) -> Summary:
    def over_seeds(value: Callable[[Record], float]) -> Estimate:
        return Estimate.of([value(run) for run in runs])

    return Summary(
        object_id=object_id,
        planner=planner,
        n_grasps=runs[0]["n_grasps"],
        mean_epsilon=over_seeds(lambda r: mean_of_best(r, "epsilon")),
        mean_volume=over_seeds(lambda r: mean_of_best(r, "volume")),
        best_epsilon=over_seeds(lambda r: best(r, "epsilon")),
        best_volume=over_seeds(lambda r: best(r, "volume")),
        best_epsilon_of_any_seed=max(best(r, "epsilon") for r in runs),
        found=over_seeds(lambda r: len(r["epsilon"])),
        successes=sum(bool(r["epsilon"]) for r in runs),
        evaluations_per_s=over_seeds(lambda r: r["n_evaluations"] / r["elapsed_s"]),
        n_evaluations=over_seeds(lambda r: r["n_evaluations"]),
        elapsed_s=over_seeds(lambda r: r["elapsed_s"]),
    )


def ratio(value: float, to: float) -> float:
    """`value / to`; infinite where only `to` is 0, NaN where both are."""
    if to == 0.0:
        return math.nan if value == 0.0 else math.inf
    return value / to


def mean_over_objects(summaries: Sequence[Summary], planner: str, quality: str) -> float:
    """Mean over the objects of the mean of the best, the base of the paper's overall ratio."""
    values = [getattr(s, f"mean_{quality}").mean for s in summaries if s.planner == planner]
    return float(np.mean(values)) if values else math.nan


def best_epsilon_at(record: Record, times: Sequence[float] | NDArray[np.float64]) -> list[float]:
    """Best epsilon known at each of `times` [s], 0 before the first grasp."""
    known = np.array([[0.0, 0.0], *([t, e] for t, _, e in record["convergence"])])
    index = np.searchsorted(known[:, 0], times, side="right") - 1
    return [float(max(known[i, 1], 0.0)) for i in index]
