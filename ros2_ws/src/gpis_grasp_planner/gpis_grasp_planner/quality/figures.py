"""The quality of a grasp as one value: named figures, each with its meaning.

A `Quality` is what a grasp carries through the answer, its document, its message and the tables; a
`Figure` says what one number in it is. Epsilon and volume are always there; the others are there
where a `Measure` was asked for (`quality.measure`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

NO_FORCE_CLOSURE = -1.0


@dataclass(frozen=True)
class Figure:
    """What a number says of a grasp.

    Attributes
    ----------
    name : str
        As in settings, documents and messages; lower case, such as ``min_weight``.
    unit : str
        Of the number; empty for a ratio.
    larger_is_better : bool
    description : str
        One sentence for users.
    source : str
        Where it is defined: paper and equation.
    """

    name: str
    unit: str
    larger_is_better: bool
    description: str
    source: str


EPSILON = Figure(
    "epsilon",
    "",
    True,
    "Radius of the largest ball in the grasp wrench space: the smallest wrench that no contact "
    "forces with normal parts of 1 in sum resist; -1 without force closure.",
    "Ferrari and Canny, ICRA 1992, the L1 space; torques over the part's largest radius.",
)
VOLUME = Figure(
    "volume",
    "",
    True,
    "6-D volume of the grasp wrench space.",
    "Miller and Allen, ICRA 1999; torques over the part's largest radius.",
)
IMBALANCE = Figure(
    "imbalance",
    "",
    False,
    "What the closing hand's own forces leave unbalanced of the worst push, over the push.",
    "max_w min |G lambda + w| / load, `quality.closing_balance`.",
)
ALWAYS = (EPSILON, VOLUME, IMBALANCE)


@dataclass(frozen=True)
class Quality:
    """Named figures of one grasp.

    Attributes
    ----------
    epsilon : float
        -1 without force closure.
    volume : float
    imbalance : float or None
        0 is best; None where nobody asked.
    measured : mapping of str to float
        Figures of measures, by name.
    """

    epsilon: float
    volume: float
    imbalance: float | None = None
    measured: Mapping[str, float] = field(default_factory=dict)

    @property
    def force_closure(self) -> bool:
        """Whether the origin is strictly inside the wrench space."""
        return self.epsilon > 0.0

    @property
    def figures(self) -> dict[str, float]:
        """All figures that are known, by name."""
        known = {EPSILON.name: self.epsilon, VOLUME.name: self.volume}
        if self.imbalance is not None:
            known[IMBALANCE.name] = self.imbalance
        return {**known, **self.measured}


def named(figures: Iterable[Figure]) -> dict[str, Figure]:
    """Figures by name; the first of a name counts."""
    found: dict[str, Figure] = {}
    for figure in figures:
        found.setdefault(figure.name, figure)
    return found
