"""What it costs that a part's surface is not known exactly: of contacts, and of whole grasps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.quality.figures import Figure
from gpis_grasp_planner.quality.measure import HeldPart, Measure
from gpis_grasp_planner.quality.objective import Figures, Objective

Array = NDArray[np.float64]

CONTACT_DEVIATION = Figure(
    "contact_deviation",
    "m",
    False,
    "Root mean square, over the contacts, of the surface's standard deviation there.",
    "Posterior of the cloud's Gaussian process, docs/point_clouds.md.",
)
SURFACE_HOLD = Figure(
    "surface_hold",
    "",
    True,
    "Share of the surfaces drawn for a point cloud on which the closing hand gets force closure.",
    "Draws of the cloud's Gaussian process, docs/point_clouds.md.",
)


def contact_deviation(deviation_at: Callable[[Array], Array]) -> Measure:
    """The measure of one part.

    Parameters
    ----------
    deviation_at : callable
        Points (m, 3) on the part's surface -> its standard deviation there (m,) [m].
    """

    def of(held: HeldPart) -> float:
        deviation = deviation_at(held.contacts.positions)
        return float(np.sqrt(np.mean(deviation**2)))

    return Measure(CONTACT_DEVIATION, of)


@dataclass(frozen=True)
class KnownContacts:
    """Another objective, less where contacts are on surface that is not known well.

    Its value times ``1 / (1 + (d / half_at)^2)`` of the contact deviation d, where that is known.

    Attributes
    ----------
    objective : Objective
    measure : Measure
        The contact deviation of the part.
    half_at : float [m]
    """

    objective: Objective
    measure: Measure
    half_at: float

    @property
    def text(self) -> str:
        """The formula."""
        return f"({self.objective.text}) / (1 + (contact_deviation / {self.half_at:g} m)^2)"

    @property
    def measures(self) -> tuple[Measure, ...]:
        """Those of the other objective, and the deviation."""
        return (*self.objective.measures, self.measure)

    def value(self, figures: Figures) -> Any:
        """As the other objective's, at most."""
        raw = np.asarray(figures.measured.get(CONTACT_DEVIATION.name, np.nan), dtype=float)
        deviation = np.where(np.isfinite(raw), raw, 0.0)
        return self.objective.value(figures) / (1.0 + (deviation / self.half_at) ** 2)
