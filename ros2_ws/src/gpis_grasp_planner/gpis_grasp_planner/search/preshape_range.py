"""What a search draws of a hand's pre-shape: within the motors' ends and a setting."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.hand.description import HandDescription

Array = NDArray[np.float64]

# Good guesses: the Barrett's fingers opposed, evenly around, and between.
_GUESSES_RAD = (0.0, np.pi / 6, np.pi / 3, np.pi / 2)


@dataclass(frozen=True, eq=False)
class PreshapeRange:
    """Range of S motors.

    Attributes
    ----------
    lower, upper : (S,) arrays [rad or m]
    unit : (S,) array
        What counts as 1 rad (`hand.preshape`).
    """

    lower: Array
    upper: Array
    unit: Array

    @classmethod
    def of(cls, hand: HandDescription, max_deg: float) -> PreshapeRange:
        """Of a hand: motors that turn up to an angle [deg], those that slide up to their end."""
        shape = hand.preshape
        most = np.where(shape.slides, np.inf, np.maximum(np.deg2rad(max_deg), shape.lower))
        return cls(shape.lower, np.minimum(shape.upper, most), shape.unit)

    def __len__(self) -> int:
        return len(self.lower)

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        """Pre-shapes (n, S), evenly."""
        low, high = np.rad2deg(self.lower), np.rad2deg(self.upper)
        return np.asarray(np.deg2rad(rng.uniform(low, high, (n, len(self)))))

    def guess(self, n: int, rng: np.random.Generator) -> Array:
        """Pre-shapes (n, S) of motors at 0, 30, 60 or 90 degrees, as far as they go."""
        return self.clip(self.unit * rng.choice(_GUESSES_RAD, (n, len(self))))

    def step(self, angle_deg: float) -> Array:
        """A step [deg] as motions of the motors (S,)."""
        return np.asarray(np.deg2rad(angle_deg) * self.unit)

    def clip(self, preshape: Array) -> Array:
        """Pre-shapes (n, S) brought into the range."""
        return np.clip(preshape, self.lower, self.upper)

    def grid(self, n: int) -> Array:
        """Pre-shapes (n^S, S) on a grid of n values a motor; one where nothing moves."""
        axes = [
            np.linspace(low, high, n if high > low else 1)
            for low, high in zip(self.lower, self.upper, strict=True)
        ]
        return np.array(list(product(*axes)), dtype=float)
