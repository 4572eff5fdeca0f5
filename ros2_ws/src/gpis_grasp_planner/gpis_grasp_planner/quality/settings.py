"""Settings of the quality of grasps: what the search looks for, and what is reported."""

from __future__ import annotations

from dataclasses import dataclass

from gpis_grasp_planner.settings import SettingsGroup, setting


@dataclass(frozen=True)
class ObjectiveSettings(SettingsGroup):
    """What is a good grasp."""

    name: str = setting(
        "paper",
        description="What the search maximises: paper (epsilon + lambda volume, lambda is "
        "hpp.volume_weight), or the name of a measure: min_weight, least_friction, task, one of "
        "an installed distribution, or module:NAME of a module that can be imported.",
        common=True,
    )
    task: str = setting(
        "lift 0 0 1",
        description="The wanted task of the measure 'task', in the part's frame: KIND X Y Z "
        "[at X Y Z], KIND one of lift, insert, turn, screw, X Y Z up or the axis, 'at' a point "
        "[m]; several joined by '+'.",
        common=True,
    )
    report: tuple[str, ...] = setting(
        ("min_weight", "least_friction"),
        description="Measures whose figures an answer's grasps have beside those of the objective.",
        common=True,
    )
