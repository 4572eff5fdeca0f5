"""What a search maximises: a number from the figures of a grasp.

The same formula takes the columns of many attempts and the figures of one grasp.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from gpis_grasp_planner.quality.balance_factor import balance_factor
from gpis_grasp_planner.quality.measure import Measure


class Figures(Protocol):
    """Figures of one grasp (floats), or of B attempts ((B,) arrays)."""

    @property
    def epsilon(self) -> Any:
        """-1 without force closure."""
        ...

    @property
    def volume(self) -> Any:
        """Of the wrench space."""
        ...

    @property
    def imbalance(self) -> Any:
        """None where nobody asked."""
        ...

    @property
    def measured(self) -> Mapping[str, Any]:
        """Figures of measures by name."""
        ...


class Objective(Protocol):
    """What makes one grasp better than another."""

    @property
    def text(self) -> str:
        """The formula, for tables and messages."""
        ...

    @property
    def measures(self) -> tuple[Measure, ...]:
        """Measures that every attempt with force closure needs, beside epsilon and volume."""
        ...

    def value(self, figures: Figures) -> Any:
        """At least 0, larger is better, 0 for what is no grasp; the closing balance is apart."""
        ...


@dataclass(frozen=True)
class EpsilonVolume:
    """The paper's f_obj = 1(epsilon) epsilon + lambda volume."""

    volume_weight: float

    @property
    def text(self) -> str:
        """The formula."""
        return f"epsilon + {self.volume_weight:g} volume"

    @property
    def measures(self) -> tuple[Measure, ...]:
        """None."""
        return ()

    def value(self, figures: Figures) -> Any:
        """Positive also without force closure, where the wrenches have a volume."""
        return np.maximum(figures.epsilon, 0.0) + self.volume_weight * figures.volume


@dataclass(frozen=True)
class OneMeasure:
    """One measure alone: its figure m, or 1 / (1 + m) where smaller is better.

    0 without force closure, and where the measure finds nothing finite.
    """

    measure: Measure

    @property
    def text(self) -> str:
        """Name of the figure, and which end of it is good."""
        figure = self.measure.figure
        return figure.name if figure.larger_is_better else f"least {figure.name}"

    @property
    def measures(self) -> tuple[Measure, ...]:
        """The one."""
        return (self.measure,)

    def value(self, figures: Figures) -> Any:
        """From 0 up."""
        figure = self.measure.figure
        raw = np.asarray(figures.measured.get(figure.name, np.nan), dtype=float)
        m = np.maximum(np.where(np.isfinite(raw), raw, 0.0), 0.0)
        good = m if figure.larger_is_better else 1.0 / (1.0 + m)
        return np.where(np.isfinite(raw) & (np.asarray(figures.epsilon) > 0.0), good, 0.0)


def worth(objective: Objective, figures: Figures) -> Any:
    """An objective's value, times the `balance_factor` where the imbalance is known."""
    value = objective.value(figures)
    return value if figures.imbalance is None else value * balance_factor(figures.imbalance)
