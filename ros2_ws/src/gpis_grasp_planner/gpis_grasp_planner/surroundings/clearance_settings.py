"""Settings of the clearance, apart from its compiled code: the node declares them as parameters."""

from __future__ import annotations

from dataclasses import dataclass

from gpis_grasp_planner.settings import SettingsGroup, setting


@dataclass(frozen=True)
class ClearanceSettings(SettingsGroup):
    """How far the hand keeps from everything but the part."""

    margin_m: float = setting(
        0.003,
        low=1e-4,
        high=0.1,
        description="Smallest distance of hand and surroundings on the whole way to the grasp.",
        common=True,
    )
    pregrasp: str = setting(
        "together",
        choices=("open", "narrow", "together"),
        description="Approach with the fingers open, just wide enough, or, beyond that, so that "
        "they arrive at the part together.",
    )
    pregrasp_clearance_m: float = setting(
        0.015,
        low=0.001,
        high=0.1,
        description="Distance that the fingers of a pre-grasp that is not open keep from the part.",
    )
    support_tolerance_m: float = setting(
        0.005,
        low=0.0,
        high=1.0,
        description="How far a part may reach into its support before a request is refused, or "
        "hover over it before that is noted.",
    )
