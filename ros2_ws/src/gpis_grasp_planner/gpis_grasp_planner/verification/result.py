"""What verification answers: frozen, with the evidence, and ready for JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class DirectionResult:
    """One push.

    Attributes
    ----------
    direction : tuple of three floats
        Unit vector of the acceleration in the palm frame.
    held : bool
    slip_m, rotation_rad : float
        Largest motion of the part relative to the palm, see `simulated_s`.
    simulated_s : float [s]
        Shorter than the protocol's duration where the part was lost, or where it stood so still
        that the rest was extrapolated (the motion then includes the extrapolated drift).
    """

    direction: tuple[float, float, float]
    held: bool
    slip_m: float
    rotation_rad: float
    simulated_s: float


@dataclass(frozen=True)
class Verification:
    """The verdict over one grasp under one friction and mass.

    Attributes
    ----------
    held : bool
        Whether the grasp passed every test that was made.
    cause : str
        "" or why it failed: "collision", "penetration", "not closed", "too few touch",
        "lost while closing" or "slipped".
    friction, mass_kg : float
    directions : tuple of DirectionResult
        Those that were tried; the first failure may end the trial.
    penetration_m : float
        Deepest at the start: of the planned posture, or after closing in physics.
    touching : tuple of str
        Names of the links that press on the part after closing.
    closing_slip_m, closing_rotation_rad : float
        How far the part went when it was let go into the closed hand.
    elapsed_s : float
        Computing time.
    engine : str
        Where it was tried; of several engines the one that the figures are of.
    """

    held: bool
    cause: str
    friction: float
    mass_kg: float
    directions: tuple[DirectionResult, ...]
    penetration_m: float
    touching: tuple[str, ...]
    closing_slip_m: float
    closing_rotation_rad: float
    elapsed_s: float
    engine: str = "bullet"

    @property
    def largest_slip_mm(self) -> float:
        """Of all directions tried; 0 where none was."""
        return 1e3 * max((d.slip_m for d in self.directions), default=0.0)

    @property
    def largest_rotation_deg(self) -> float:
        """Of all directions tried; 0 where none was."""
        return float(np.degrees(max((d.rotation_rad for d in self.directions), default=0.0)))

    def as_dict(self) -> dict[str, Any]:
        """All fields and the margins, ready for JSON."""
        return asdict(self) | {
            "largest_slip_mm": self.largest_slip_mm,
            "largest_rotation_deg": self.largest_rotation_deg,
        }
