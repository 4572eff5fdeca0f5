"""All settings of the planner, by group."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from gpis_grasp_planner.arm.settings import ArmSettings
from gpis_grasp_planner.disk_cache import CacheSettings
from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.grasp.constraint_settings import ConstraintSettings
from gpis_grasp_planner.grasp.scene_settings import SceneSettings
from gpis_grasp_planner.hand.settings import HandSettings
from gpis_grasp_planner.plan.store_settings import StoreSettings
from gpis_grasp_planner.quality.settings import ObjectiveSettings
from gpis_grasp_planner.search.settings import (
    AdaptionSettings,
    AdmmCpSettings,
    ContactSettings,
    DualSettings,
    HppSettings,
    RefinementSettings,
    SearchSettings,
)
from gpis_grasp_planner.settings import SettingsGroup
from gpis_grasp_planner.surface.settings import SurfaceSettings
from gpis_grasp_planner.surroundings.clearance_settings import ClearanceSettings
from gpis_grasp_planner.surroundings.uncertainty_settings import UncertaintySettings
from gpis_grasp_planner.verification.settings import VerificationSettings


@dataclass(frozen=True)
class PlannerSettings:
    """The groups; a setting's full name is ``group.name``, as in the ROS parameters."""

    hand: HandSettings = field(default_factory=HandSettings)
    arm: ArmSettings = field(default_factory=ArmSettings)
    scene: SceneSettings = field(default_factory=SceneSettings)
    surface: SurfaceSettings = field(default_factory=SurfaceSettings)
    adaption: AdaptionSettings = field(default_factory=AdaptionSettings)
    hpp: HppSettings = field(default_factory=HppSettings)
    refinement: RefinementSettings = field(default_factory=RefinementSettings)
    dual: DualSettings = field(default_factory=DualSettings)
    contacts: ContactSettings = field(default_factory=ContactSettings)
    admm: AdmmCpSettings = field(default_factory=AdmmCpSettings)
    verification: VerificationSettings = field(default_factory=VerificationSettings)
    clearance: ClearanceSettings = field(default_factory=ClearanceSettings)
    objective: ObjectiveSettings = field(default_factory=ObjectiveSettings)
    constraints: ConstraintSettings = field(default_factory=ConstraintSettings)
    uncertainty: UncertaintySettings = field(default_factory=UncertaintySettings)
    cache: CacheSettings = field(default_factory=CacheSettings)
    store: StoreSettings = field(default_factory=StoreSettings)

    @property
    def search(self) -> SearchSettings:
        """The groups that a search reads."""
        return SearchSettings(**{f.name: getattr(self, f.name) for f in fields(SearchSettings)})

    def as_dict(self) -> dict[str, dict[str, Any]]:
        """Values by group and name, ready for JSON."""
        return {f.name: getattr(self, f.name).as_dict() for f in fields(self)}

    @classmethod
    def from_mapping(cls, values: Mapping[str, Mapping[str, Any]]) -> PlannerSettings:
        """Build from groups of names and values; unknown ones are errors naming the known."""
        groups = setting_groups()
        unknown = sorted(set(values) - set(groups))
        if unknown:
            raise RequestError(
                f"Unknown group of settings {', '.join(unknown)}; known are {', '.join(groups)}."
            )
        made: dict[str, Any] = {
            name: groups[name].from_mapping(group) for name, group in values.items()
        }
        return cls(**made)


def setting_groups() -> dict[str, type[SettingsGroup]]:
    """The groups' classes by name."""
    default = PlannerSettings()
    return {f.name: type(getattr(default, f.name)) for f in fields(default)}
