"""The lift's accelerations are those of the motion it claims; a firm grasp bears them."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.verification.protocol import Verifier
from gpis_grasp_planner.verification.settings import VerificationSettings
from gpis_grasp_planner.verification.table_lift import (
    GRAVITY_M_S2,
    lift_accelerations,
    verify_lift,
)


def test_the_motion_is_a_lift_and_a_shake() -> None:
    up = np.array([0.0, 0.6, 0.8])
    palm = -(lift_accelerations(up, 0.2, 0.03) + GRAVITY_M_S2 * up)
    dt = 1 / 60
    speed = np.cumsum(palm, axis=0) * dt
    # the middle of an interval is half a step later than its end
    path = np.cumsum(speed - 0.5 * dt * palm, axis=0) * dt
    assert path[119] == pytest.approx(0.2 * up, abs=1e-3)
    assert speed[119] == pytest.approx(np.zeros(3), abs=1e-9)
    assert speed[-1] == pytest.approx(np.zeros(3), abs=1e-9)
    shake = path[120:] - path[119]
    for first in (0, 30, 60):
        assert np.linalg.norm(shake[first : first + 30], axis=1).max() == pytest.approx(
            0.03, rel=0.05
        )
    assert np.linalg.norm(shake[29]) < 1e-3
    assert len(palm) * dt == pytest.approx(3.5)


def test_a_firm_grasp_lifts_and_a_frictionless_one_drops(
    bar: Part, hand: HandDescription, firm: Grasp
) -> None:
    along = np.array([1.0, 0.0, 0.0])
    with Verifier(bar, hand, VerificationSettings()) as verifier:
        found = verify_lift(verifier, firm, along)
    assert found.held
    assert found.slip_m < 0.002
    assert found.simulated_s == pytest.approx(3.5, abs=0.01)
    with Verifier(bar, hand, VerificationSettings(friction=0.0)) as verifier:
        dropped = verify_lift(verifier, firm, along)
    assert not dropped.held
    assert dropped.cause == "slipped"
    assert dropped.simulated_s < 1.0
