"""Settings of the scene: contact, closing and approach."""

from __future__ import annotations

from dataclasses import dataclass

from gpis_grasp_planner.settings import SettingsGroup, setting


@dataclass(frozen=True)
class SceneSettings(SettingsGroup):
    """How hand and object meet."""

    contact_threshold_m: float = setting(
        2e-4, low=1e-5, high=2e-3, description="Bodies nearer than this, but apart, touch."
    )
    closing_gap_m: float = setting(
        3e-5, low=1e-6, high=1e-3, description="Gap at which a closing link stops."
    )
    cone_edges: int = setting(
        8, low=3, high=32, description="Edges of the pyramid that replaces a friction cone."
    )
    search_evaluator: str = setting(
        "compiled",
        choices=("compiled", "bullet"),
        description="What closes the hand during the search: compiled code (about 1 ms a grasp) "
        "or PyBullet (50 to 500 ms; for comparison).",
    )
    confirm: bool = setting(
        True,
        description="Look at the finalists in PyBullet's scene and drop those that penetrate or "
        "miss a contact there.",
    )
    confirm_tolerance_m: float = setting(
        5e-5,
        low=0.0,
        high=1e-3,
        description="Penetration that counts as none in PyBullet's scene: its collision margin "
        "and single precision.",
    )
    field_cells: int = setting(
        96, low=24, high=256, description="Cells of the distance field along the longest side."
    )
    lambda_step_m: float = setting(
        0.005, low=5e-4, high=0.05, description="Delta lambda of Alg. 2: step away from the chart."
    )
    lambda_max_m: float = setting(
        0.12,
        low=0.0,
        high=0.5,
        description="lambda_max of Alg. 2: farthest the palm moves from the chart.",
    )
    theta_step_deg: float = setting(
        15.0,
        low=1.0,
        high=180.0,
        description="Delta theta_z of Alg. 2: turn where lambda_max does not free the hand.",
    )
    retreat_m: float = setting(
        0.10,
        low=0.0,
        high=0.5,
        description="The open hand must be able to go back this far along the palm's axis.",
    )
