"""The tests of a success study on one grasp: the strict protocol in its cases, ready for JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.verification.cases import LEAST_KG
from gpis_grasp_planner.verification.pose_noise import displacements
from gpis_grasp_planner.verification.protocol import PreparedPart, Verifier, prepare
from gpis_grasp_planner.verification.result import Verification
from gpis_grasp_planner.verification.settings import VerificationSettings
from gpis_grasp_planner.verification.table_lift import LiftResult, verify_lift

NOMINAL = "nominal"
SLIPPERY = "slippery"
SLIPPERY_CAD = "slippery, CAD mass"
NOISE = "pose noise"
LIFT = "table lift"
TESTS = (NOMINAL, SLIPPERY, SLIPPERY_CAD, NOISE, LIFT)

DENSITY_KG_M3 = 1000.0


def volume_mass(part: Part, settings: VerificationSettings) -> float:
    """Mass of the part's volume at 1000 kg/m^3; the usual one where the hand cannot carry it.

    Whatever the part's file says: the protocol compares parts of one density.
    """
    mass = max(DENSITY_KG_M3 * part.volume, LEAST_KG)
    return float(mass) if mass < settings.payload_kg else settings.mass_kg


class StrictTests:
    """Tries grasps of one part; every kind of test in a simulation of its own.

    Parameters
    ----------
    part : Part
    hand : HandDescription
    settings : VerificationSettings
        Of the protocol: both frictions, the usual mass, the noise.
    planner : str
        Whose grasps they are.
    """

    def __init__(
        self, part: Part, hand: HandDescription, settings: VerificationSettings, planner: str
    ):
        self.part, self.hand, self.settings, self.planner = part, hand, settings, planner
        self._prepared: PreparedPart = prepare(part, settings)

    def nominal(self, grasps: Sequence[Grasp], first_rank: int = 0) -> list[dict[str, Any]]:
        """The protocol's friction and usual mass, six directions each."""
        with self._verifier() as verifier:
            return [
                self._row(NOMINAL, rank, verifier, verifier.verify(grasp))
                for rank, grasp in enumerate(grasps, first_rank)
            ]

    def further(self, grasp: Grasp, noise_seed: int) -> list[dict[str, Any]]:
        """The other tests of the first grasp; a row per displacement under pose noise."""
        rows = []
        settings = self.settings
        little = replace(settings, friction=settings.low_friction)
        cad = replace(little, mass_kg=volume_mass(self.part, settings))
        for test, case in ((SLIPPERY, little), (SLIPPERY_CAD, cad)):
            with self._verifier(case) as verifier:
                rows.append(self._row(test, 0, verifier, verifier.verify(grasp)))
        with self._verifier(stop_at_failure=True) as verifier:
            rows += [
                self._row(NOISE, 0, verifier, verifier.verify_displaced(grasp, T))
                for T in displacements(self.part, self.settings, noise_seed)
            ]
        with self._verifier() as verifier:
            # The palm comes from above.
            lift = verify_lift(verifier, grasp, -grasp.approach_direction)
            rows.append(self._row(LIFT, 0, verifier, lift))
        return rows

    def _verifier(
        self, settings: VerificationSettings | None = None, stop_at_failure: bool = False
    ) -> Verifier:
        used = settings or self.settings
        return Verifier(self.part, self.hand, used, self._prepared, stop_at_failure)

    def _row(
        self, test: str, rank: int, verifier: Verifier, found: Verification | LiftResult
    ) -> dict[str, Any]:
        row: dict[str, Any] = {
            "test": test,
            "planner": self.planner,
            "rank": rank,
            "held": found.held,
            "cause": found.cause,
            "friction": verifier.settings.friction,
            "mass_kg": verifier.settings.mass_kg,
            "elapsed_s": found.elapsed_s,
        }
        if isinstance(found, LiftResult):
            return row | {
                "slip_mm": 1e3 * found.slip_m,
                "turn_deg": float(np.degrees(found.rotation_rad)),
            }
        return row | {
            "slip_mm": found.largest_slip_mm,
            "turn_deg": found.largest_rotation_deg,
            "closing_slip_mm": 1e3 * found.closing_slip_m,
            "closing_turn_deg": float(np.degrees(found.closing_rotation_rad)),
            "penetration_mm": 1e3 * found.penetration_m,
            "touching": list(found.touching),
            "directions_held": sum(direction.held for direction in found.directions),
        }
