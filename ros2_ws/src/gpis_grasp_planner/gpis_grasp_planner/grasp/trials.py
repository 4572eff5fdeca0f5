"""What physics said about a grasp, as planning and its answers carry it.

The trials themselves are made in ``verification``, above this folder; here is only their record.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

# What a request asks for. "none": nothing is tried. "rank": grasps that hold come first.
# "require": no others are answered.
VERIFICATIONS = ("none", "rank", "require")


# In the name of a trial in which the part does not lie where it was planned.
DISPLACED = ", displaced"

_GENTLE_M = 0.005
_GENTLE_RAD = math.radians(5.0)


@dataclass(frozen=True)
class TrialOutcome:
    """One trial of one grasp.

    Attributes
    ----------
    name : str
        What was tried and where, such as "friction 0.6, 0.1 kg, mujoco".
    passed : bool
    cause : str
        Why it failed; empty where it passed.
    slip_m, rotation_rad : float
        Largest motion of the part against the palm.
    closing_slip_m, closing_rotation_rad : float
        How far the closed hand pushed the part when its support gave way.
    """

    name: str
    passed: bool
    cause: str = ""
    slip_m: float = 0.0
    rotation_rad: float = 0.0
    closing_slip_m: float = 0.0
    closing_rotation_rad: float = 0.0


@dataclass(frozen=True)
class HoldEstimate:
    """How probably a grasp holds under friction, mass and pose as they may be in the cell.

    Attributes
    ----------
    probability : float
        Expected, in [0, 1].
    low, high : float
        Central interval of 90 %.
    n : int
        Trials of the grasp itself behind it; with none it is what its like did.
    """

    probability: float
    low: float
    high: float
    n: int


@dataclass(frozen=True)
class Trials:
    """The trials of one grasp in the order in which they were made.

    The first is the nominal one and decides whether the grasp holds; the further ones (other
    friction and mass, another engine, displaced parts) say how probably.
    """

    outcomes: tuple[TrialOutcome, ...]

    @property
    def held(self) -> bool:
        """Whether the grasp passed the nominal trial."""
        return bool(self.outcomes) and self.outcomes[0].passed

    @property
    def n_passed(self) -> int:
        """How many trials the grasp passed."""
        return sum(outcome.passed for outcome in self.outcomes)

    @property
    def gentle(self) -> bool:
        """Whether the closed hand pushed the part by less than 5 mm and 5 degrees."""
        first = self.outcomes[0]
        return first.closing_slip_m < _GENTLE_M and first.closing_rotation_rad < _GENTLE_RAD

    @property
    def steady(self) -> bool:
        """Whether no trial failed in which the part lay where it was planned.

        That are the nominal one, the same in another engine, and the hardest friction and mass.
        """
        return all(outcome.passed for outcome in self.outcomes if DISPLACED not in outcome.name)

    @property
    def largest_slip_m(self) -> float:
        """Over the trials passed; 0 where none was."""
        return max((o.slip_m for o in self.outcomes if o.passed), default=0.0)

    @property
    def largest_rotation_rad(self) -> float:
        """Over the trials passed; 0 where none was."""
        return max((o.rotation_rad for o in self.outcomes if o.passed), default=0.0)
