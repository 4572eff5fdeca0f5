"""Bullet as an engine: how much solving a light part takes."""

from __future__ import annotations

import pytest

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.verification.bullet.engine import iterations
from gpis_grasp_planner.verification.protocol import Verifier
from gpis_grasp_planner.verification.settings import VerificationSettings


@pytest.mark.parametrize(
    ("mass", "expected"), [(0.1, 400), (2.0, 400), (0.025, 800), (0.001, 4000)]
)
def test_iterations_grow_with_the_root_of_lightness(mass: float, expected: int) -> None:
    assert iterations(VerificationSettings(mass_kg=mass)) == expected


def test_fingers_do_not_sink_into_a_light_part(
    bar: Part, hand: HandDescription, firm: Grasp
) -> None:
    with Verifier(bar, hand, VerificationSettings(mass_kg=0.005, engine="bullet")) as verifier:
        light = verifier.verify(firm)
        verifier.use(VerificationSettings(mass_kg=0.1, engine="bullet"))
        usual = verifier.verify(firm)
    assert light.held
    assert usual.held
    assert light.penetration_m < 2e-4
