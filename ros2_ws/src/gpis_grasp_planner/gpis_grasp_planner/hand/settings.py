"""Which hand grasps."""

from __future__ import annotations

from dataclasses import dataclass

from gpis_grasp_planner.settings import SettingsGroup, setting

DEFAULT_HAND = "barrett_bh280"


@dataclass(frozen=True)
class HandSettings(SettingsGroup):
    """The hand that plans are for."""

    model: str = setting(
        DEFAULT_HAND,
        description="The hand: a name that 'gpis-grasp hand list' shows, or a hand's YAML file.",
        common=True,
    )
