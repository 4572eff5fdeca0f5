"""Settings of the rival planners; the defaults are the original simulator's."""

from __future__ import annotations

from dataclasses import dataclass

from gpis_grasp_planner.settings import SettingsGroup, setting


@dataclass(frozen=True)
class RivalSettings(SettingsGroup):
    """Parameters of the annealing planners (annealing, eigengrasp, eigengrasp-two-level)."""

    largest_step: str = setting(
        "variable",
        choices=("variable", "range"),
        description="Largest step of the annealing: each variable's own as in the original "
        "simulator (150 mm, 36 and 90 deg, 2 amplitudes), or its whole range.",
    )
    last_step: int = setting(
        100_000,
        low=1,
        high=10**9,
        description="Step k of the cooling schedule (from 30000) at which it starts anew.",
    )
    best_states: int = setting(
        20, low=1, high=1000, description="Length of EigenGrasp's list of best distinct states."
    )
    states_apart: float = setting(
        0.2,
        low=0.0,
        high=10.0,
        description="Distance of states in that list: max(translation / maxRadius, angle / 2 pi).",
    )
    approach_m: float = setting(
        0.03,
        low=0.0,
        high=0.5,
        description="How far a hand moves along the palm's axis to touch before it closes.",
    )
    seed_energy: float = setting(
        -0.1,
        low=-1e3,
        high=1e3,
        description="EigenGrasp's states below this energy seed children (two-level).",
    )
    seeds_apart: float = setting(
        0.3,
        low=0.0,
        high=10.0,
        description="Distance of seeds from each other, and that the parent keeps from them.",
    )
    child_steps: int = setting(
        200, low=1, high=10**6, description="Steps of a child's annealing (two-level)."
    )
    states_per_child_state: int = setting(
        4,
        low=1,
        high=1000,
        description="States of the parent for each of its child's; the default gives about equal "
        "time, as two threads on one core get it.",
    )
