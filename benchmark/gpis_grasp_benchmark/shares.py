"""Shares of objects with their 95 % intervals, and the comparison of paired ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest, norm

CONFIDENCE = 0.95
_RESAMPLES = 10_000


@dataclass(frozen=True)
class Share:
    """`passed` of `n`."""

    passed: int
    n: int

    @staticmethod
    def of(verdicts: Sequence[bool]) -> Share:
        """Count verdicts."""
        return Share(sum(verdicts), len(verdicts))

    @property
    def value(self) -> float:
        """The share; NaN of nothing."""
        return self.passed / self.n if self.n else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's score interval: E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209."""
        if not self.n:
            return 0.0, 1.0
        z = float(norm.ppf(0.5 + 0.5 * CONFIDENCE))
        scale = 1.0 + z**2 / self.n
        middle = (self.value + 0.5 * z**2 / self.n) / scale
        spread = self.value * (1.0 - self.value) / self.n + 0.25 * z**2 / self.n**2
        half = z * math.sqrt(spread) / scale
        # At the ends the two terms agree but for rounding.
        low = 0.0 if self.passed == 0 else max(middle - half, 0.0)
        return low, 1.0 if self.passed == self.n else min(middle + half, 1.0)


@dataclass(frozen=True)
class MeanInterval:
    """A mean over objects with the 95 % interval of the bootstrap over objects."""

    mean: float
    low: float
    high: float
    n: int

    @staticmethod
    def of(values: Sequence[float]) -> MeanInterval:
        """Resample the objects 10,000 times (percentiles, a fixed seed)."""
        if not values:
            return MeanInterval(math.nan, math.nan, math.nan, 0)
        sample = np.asarray(values, dtype=float)
        rng = np.random.default_rng(0)
        rows = rng.integers(len(sample), size=(_RESAMPLES, len(sample)))
        tail = 50.0 * (1.0 - CONFIDENCE)
        low, high = np.percentile(sample[rows].mean(axis=1), [tail, 100.0 - tail])
        return MeanInterval(float(sample.mean()), float(low), float(high), len(sample))


def mcnemar(first: Sequence[bool], second: Sequence[bool]) -> float:
    """Two-sided p-value that two paired verdicts pass alike: exact, over the pairs that differ."""
    only_first = sum(a and not b for a, b in zip(first, second, strict=True))
    only_second = sum(b and not a for a, b in zip(first, second, strict=True))
    differing = only_first + only_second
    return float(binomtest(only_first, differing).pvalue) if differing else 1.0
