"""Settings of the constraints that users add."""

from __future__ import annotations

from dataclasses import dataclass

from gpis_grasp_planner.settings import SettingsGroup, setting


@dataclass(frozen=True)
class ConstraintSettings(SettingsGroup):
    """What grasps must respect beside the surroundings and the request."""

    names: tuple[str, ...] = setting(
        (),
        description="Constraints of your own: names of installed distributions, or module:NAME "
        "of a module that can be imported. Their code runs in the planner.",
        common=True,
    )
