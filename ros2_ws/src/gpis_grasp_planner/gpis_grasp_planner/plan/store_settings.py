"""Settings of the grasp store (`store.grasp_store`), declared where all groups are."""

from __future__ import annotations

from dataclasses import dataclass

from gpis_grasp_planner.settings import SettingsGroup, setting


@dataclass(frozen=True)
class StoreSettings(SettingsGroup):
    """Plans kept on disk between processes and restarts."""

    enabled: bool = setting(
        True,
        description="Whether plans are kept on disk and answered from there.",
        common=True,
    )
    path: str = setting(
        "",
        description="File of the store; empty: the environment's GPIS_GRASP_STORE (a file, or "
        "'off'), else 'grasps.sqlite' in the user's data folder.",
        common=True,
    )
    most_megabytes: int = setting(
        2000,
        low=1,
        high=10_000_000,
        description="Size of all plans together beyond which what was not used for longest goes.",
    )
    wait_s: float = setting(
        2.0,
        low=0.0,
        high=600.0,
        description="How long one waits for another process that is writing.",
    )
