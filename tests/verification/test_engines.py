"""The door by which engines come."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.verification import engines
from gpis_grasp_planner.verification.protocol import Verifier
from gpis_grasp_planner.verification.settings import VerificationSettings


def test_both_are_all_engines() -> None:
    assert engines.engine_names("both") == ("bullet", "mujoco")
    assert engines.engine_names("mujoco") == ("mujoco",)
    assert engines.engine_names("auto") == ("mujoco",)


def test_a_library_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "find_spec", lambda name: None)
    assert engines.engine_names("bullet") == engines.engine_names("auto") == ("bullet",)
    with pytest.raises(RequestError, match="pip install mujoco") as caught:
        engines.engine_names("both")
    assert caught.value.code is ErrorCode.INVALID_SETTING


def test_an_engine_that_is_none_is_refused() -> None:
    with pytest.raises(RequestError, match="engine"):
        VerificationSettings(engine="havok")


@pytest.mark.parametrize("friction", [0.6, 0.0])
def test_each_engine_tries_and_both_agree_on_what_is_plain(
    friction: float, bar: Part, hand: HandDescription, firm: Grasp
) -> None:
    verdicts = {}
    for name in ("bullet", "mujoco", "both"):
        settings = VerificationSettings(engine=name, friction=friction)
        with Verifier(bar, hand, settings) as verifier:
            assert [world.name for world in verifier.worlds] == list(engines.engine_names(name))
            verdicts[name] = verifier.verify(firm)
    assert [v.held for v in verdicts.values()] == [friction > 0.0] * 3
    assert verdicts["mujoco"].engine == "mujoco"
    if friction > 0.0:
        slips = [verdicts[name].largest_slip_mm for name in ("bullet", "mujoco")]
        assert verdicts["both"].largest_slip_mm == pytest.approx(max(slips), abs=1e-6)
        assert np.isfinite(slips).all()
    else:
        assert verdicts["both"].engine == "bullet"
