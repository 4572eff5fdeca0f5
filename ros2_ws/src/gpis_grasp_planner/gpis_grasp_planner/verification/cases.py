"""Which trials a finalist has to go through, from the one that decides to those beyond it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.grasp.trials import TrialOutcome
from gpis_grasp_planner.verification.engines import engine_names
from gpis_grasp_planner.verification.pose_noise import displacements, drawn_displacements
from gpis_grasp_planner.verification.result import Verification
from gpis_grasp_planner.verification.settings import VerificationSettings

Array = NDArray[np.float64]

LEAST_KG = 1e-3


@dataclass(frozen=True, eq=False)
class TrialCase:
    """One trial by the strict protocol: its name, its settings, and where the part lies.

    `displacement` (4, 4) is that of :meth:`Verifier.verify_displaced`; None: where it was planned.
    """

    name: str
    settings: VerificationSettings
    displacement: Array | None = None

    def outcome(self, verdict: Verification) -> TrialOutcome:
        """What a verdict over a grasp in this case says, as answers carry it."""
        return TrialOutcome(
            self.name,
            verdict.held,
            verdict.cause,
            1e-3 * verdict.largest_slip_mm,
            float(np.radians(verdict.largest_rotation_deg)),
            verdict.closing_slip_m,
            verdict.closing_rotation_rad,
        )


def cad_mass(part: Part, settings: VerificationSettings) -> float:
    """Mass [kg] of the part, or the protocol's where the hand could not carry the part.

    A part lighter than 1 g counts as 1 g.
    """
    return max(part.mass, LEAST_KG) if part.mass <= settings.payload_kg else settings.mass_kg


def finalist_cases(
    part: Part,
    friction: Friction,
    settings: VerificationSettings,
    seed: int,
    covariance: Array | None = None,
) -> Sequence[TrialCase]:
    """The cases in the order of their weight; the first one decides whether a grasp holds.

    It is the strict protocol at the settings' friction, or at the friction that was planned
    with where that is less. Then the same with half slippery fingers and the CAD mass, and with
    displaced parts: by the settings' distance and angle, or drawn from the covariance (6, 6) of
    the pose in the object's axes where that is known.
    """
    nominal = replace(settings, friction=min(settings.friction, friction.finger))
    mass = cad_mass(part, settings)
    slippery = replace(nominal, friction=min(settings.low_friction, friction.finger), mass_kg=mass)
    if covariance is None:
        moved = displacements(part, settings, seed)
        where = f"{1e3 * settings.noise_m:g} mm and {settings.noise_deg:g} deg off"
    else:
        moved = drawn_displacements(covariance, settings.noise_repeats, seed)
        where = "displaced by the covariance"
    return [
        TrialCase(_name(nominal), nominal),
        TrialCase(_name(slippery), slippery),
        *(
            TrialCase(f"{_name(nominal)}, {where}, {k + 1}", nominal, move)
            for k, move in enumerate(moved)
        ),
    ]


def _name(settings: VerificationSettings) -> str:
    engines = " and ".join(engine_names(settings.engine))
    return f"friction {settings.friction:g}, {settings.mass_kg:.3g} kg, {engines}"
