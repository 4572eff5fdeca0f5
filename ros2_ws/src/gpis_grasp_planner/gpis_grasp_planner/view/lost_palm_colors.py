"""Lost palms as coloured points with a legend, for the page and for pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.funnel import Funnel, Loss, Step
from gpis_grasp_planner.grasp.lost_palms import LostPalms

Array = NDArray[np.float64]
Color = tuple[int, int, int]

# What the part or the hand itself forbids, and where nothing holds: cold; what passed much: warm.
_OF_THE_PLANNER: dict[str, Color] = {
    Loss.DEEP: (110, 110, 120),
    Loss.PALM: (60, 60, 70),
    Loss.ITSELF: (130, 90, 170),
    Loss.NOTHING: (150, 200, 235),
    Loss.ONE: (70, 150, 220),
    Loss.SLACK: (20, 80, 170),
    Loss.WAY_BACK: (150, 110, 60),
    Loss.INEXACT: (0, 160, 150),
    Loss.MARGIN: (240, 180, 0),
    Loss.SCENE: (0, 110, 100),
}
# Surroundings and the request, which a user can change: in the order in which they come.
_OF_THE_PLACE: tuple[Color, ...] = (
    (215, 40, 40), (240, 120, 20), (220, 60, 160), (160, 0, 90), (250, 90, 90),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class PaintedPalms:
    """Palms of one cause.

    Attributes
    ----------
    label : str
        Step, cause, and how many hands were lost by it.
    color : (3,) tuple of int
        Red, green, blue, 0 to 255.
    positions : (n, 3) array [m]
        Some of them, in the object's frame.
    """

    label: str
    color: Color
    positions: Array


def painted_palms(lost: LostPalms, funnel: Funnel) -> list[PaintedPalms]:
    """Every cause with its colour, in the order of the steps.

    Causes of the planner have colours of their own, the same in every picture; those of the place
    (support, obstacles, arm, forbidden regions) have warm ones.
    """
    of_place: dict[str, Color] = {}
    painted = []
    for (step, cause), positions in lost.positions.items():
        color = _OF_THE_PLANNER.get(cause) or of_place.setdefault(
            cause, _OF_THE_PLACE[len(of_place) % len(_OF_THE_PLACE)]
        )
        n = funnel.lost.get((step, cause), len(positions))
        painted.append(PaintedPalms(f"{_before(step)}{cause} ({n})", color, positions))
    return painted


def _before(step: Step) -> str:
    """The same cause may stop a hand before it closes and after."""
    return "blocked, " if step is Step.CLEAR else ""
