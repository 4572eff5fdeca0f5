"""Settings of the arm, apart from the libraries that compute with it."""

from __future__ import annotations

from dataclasses import dataclass

from gpis_grasp_planner.settings import SettingsGroup, setting


@dataclass(frozen=True)
class ArmSettings(SettingsGroup):
    """The arm that carries the hand, and what its way must keep."""

    model: str = setting(
        "",
        description="The arm: six_axis, seven_axis, or an arm's YAML file with its base and "
        "flange; empty: no arm is considered.",
        common=True,
    )
    margin_m: float = setting(
        0.01,
        low=0.0,
        high=0.2,
        description="Smallest distance of the arm from the surroundings, the part, the hand and "
        "itself.",
        common=True,
    )
    lift_m: float = setting(
        0.10,
        low=0.0,
        high=1.0,
        description="The arm must be able to lift the hand straight this far.",
        common=True,
    )
    step_m: float = setting(
        0.01,
        low=0.001,
        high=0.05,
        description="Distance of the places on approach and lift at which the arm is looked at.",
    )
    deviation_m: float = setting(
        0.001,
        low=1e-5,
        high=0.02,
        description="How far the flange may leave the straight line where the joints move in "
        "proportion between two such places.",
    )
    locked_values: int = setting(
        48,
        low=1,
        high=720,
        description="Values of the redundant joint of a seven-axis arm that are looked at.",
    )
    manipulability_weight: float = setting(
        0.0,
        low=0.0,
        high=10.0,
        description="Weight of the arm's manipulability (0 to 1) in the objective beside epsilon.",
        common=True,
    )
