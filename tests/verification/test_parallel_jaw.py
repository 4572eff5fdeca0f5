"""A gripper whose jaws slide, in both engines: what it holds, and what slides out of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hand_models import closed_on

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.verification.protocol import verify
from gpis_grasp_planner.verification.settings import VerificationSettings

HAND = load_hand("parallel_jaw")
PAD_MIDDLE = 0.127  # height over the palm frame [m]


@pytest.fixture
def bar(make_box) -> Part:
    return make_box(0.06, 0.03, 0.04)


@pytest.mark.parametrize("engine", ["bullet", "mujoco"])
def test_a_bar_between_flat_pads_holds(engine: str, bar: Part) -> None:
    grasp = closed_on(HAND, bar, np.array([0.0, 0.008, PAD_MIDDLE]))
    [verdict] = verify(bar, HAND, [grasp], VerificationSettings(engine=engine))
    assert verdict.held, verdict.cause
    assert verdict.engine == engine
    assert set(verdict.touching) == {"left_jaw_link", "right_jaw_link"}
    assert verdict.largest_slip_mm < 2.0
    assert verdict.largest_rotation_deg < 5.0
    assert verdict.closing_slip_m < 1e-3


def test_without_friction_it_goes_along_the_pads_alone(bar: Part) -> None:
    """In MuJoCo; in Bullet what the solver leaves over works it out in a second."""
    grasp = closed_on(HAND, bar, np.array([0.0, 0.0, PAD_MIDDLE]))
    settings = VerificationSettings(engine="mujoco", friction=0.0)
    [verdict] = verify(bar, HAND, [grasp], settings, stop_at_failure=False)
    held = {d.direction for d in verdict.directions if d.held}
    # down to the palm's face, 13 mm below the bar, it does not get away either
    assert held == {(0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)}


@pytest.mark.parametrize("engine", ["bullet", "mujoco"])
def test_a_jaw_presses_with_the_set_force(engine: str, bar: Part) -> None:
    """A bar of 1 kg under 15 m/s^2 weighs as much as the friction of two pads holds, or more."""
    grasp = closed_on(HAND, bar, np.array([0.0, 0.0, PAD_MIDDLE]))
    firm = VerificationSettings(engine=engine, mass_kg=1.0, friction=0.6, tip_force_n=20.0)
    weak = replace(firm, tip_force_n=8.0, holding_force_n=10.0)
    verdicts = {
        name: verify(bar, HAND, [grasp], settings, stop_at_failure=False)[0]
        for name, settings in (("firm", firm), ("weak", weak))
    }
    # 2 x 20 N x 0.6 = 24 N against 15 N; 2 x 8 N x 0.6 = 9.6 N
    along = {
        name: [d.held for d in verdict.directions if abs(d.direction[0]) == 1.0]
        for name, verdict in verdicts.items()
    }
    assert along == {"firm": [True, True], "weak": [False, False]}
