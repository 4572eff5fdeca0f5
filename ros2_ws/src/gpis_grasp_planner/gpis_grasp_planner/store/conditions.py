"""What a kept plan depends on, but for the place of the part: the store's key.

All of it is written out, so that a kept plan says for what it is good: the mesh by its content and
what its sidecar adds (mass, centre of mass), the hand, the request, the settings and the sources of
the planner. Not part of it are the time budget and the number of grasps, by which a larger plan
serves a smaller request (`store.grasp_store.GraspStore.find`), and the covariance of a pose, for
which the probabilities to hold are computed anew.
"""

from __future__ import annotations

import functools
import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gpis_grasp_planner
from gpis_grasp_planner.arm.description import load_arm
from gpis_grasp_planner.disk_cache import code_version
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.plan.objective import settings_for
from gpis_grasp_planner.plan.own_constraints import identities
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings

# Where things are kept decides no plan.
_NOT_DECISIVE = ("cache", "store")
_SOURCES = (
    "errors.py", "settings.py", "geometry", "surface", "hand", "quality", "optimise", "grasp",
    "scene", "surroundings", "search", "arm", "verification", "plan",
)  # fmt: skip


@functools.cache
def planner_version() -> str:
    """The package's version and a hash over the sources and hand models that make a plan."""
    digest = hashlib.sha256(code_version(*_SOURCES).encode())
    package = Path(gpis_grasp_planner.__file__).parent
    models = [p for folder in ("arm", "hand") for p in (package / folder / "models").rglob("*")]
    for path in sorted(p for p in models if p.is_file() and p.suffix != ".pyc"):
        digest.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    return f"{gpis_grasp_planner.__version__}+{digest.hexdigest()[:16]}"


@dataclass(frozen=True)
class Conditions:
    """Plain values that say for what a plan was made; equal where the plan would be.

    Attributes
    ----------
    values : str
        JSON with sorted names.
    """

    values: str

    @property
    def key(self) -> str:
        """SHA-256 (hex) of the values."""
        return hashlib.sha256(self.values.encode()).hexdigest()

    def as_mapping(self) -> dict[str, Any]:
        """The values by name."""
        mapping: dict[str, Any] = json.loads(self.values)
        return mapping

    @staticmethod
    def from_mapping(values: object) -> Conditions:
        """The conditions of plain values."""
        return Conditions(json.dumps(values, sort_keys=True))

    @staticmethod
    def of(
        part: Part, request: PlanRequest, settings: PlannerSettings, hand: HandDescription
    ) -> Conditions:
        """The conditions of a request for a part.

        Parameters
        ----------
        part : Part
        request : PlanRequest
        settings : PlannerSettings
        hand : HandDescription
        """
        friction = request.friction_for(part.friction)
        asked = settings_for(request, settings)
        decisive = {n: v for n, v in asked.as_dict().items() if n not in _NOT_DECISIVE}
        arm = settings.arm.model
        simplified = None if part.simplified is None else part.simplified.content_hash
        return Conditions.from_mapping(
            {
                "planner_version": planner_version(),
                "mesh_hash": part.mesh.content_hash,
                "simplified_hash": simplified,
                "surface": None if part.uncertainty is None else part.uncertainty.content_hash,
                "mass": float(part.mass),
                "center_of_mass": part.center_of_mass.tolist(),
                "hand": hand.name,
                "hand_identity": hand.identity,  # with the content of files of the user's own
                "planner": request.planner,
                "seed": request.seed,
                "max_evaluations": request.max_evaluations,
                "verification": request.verification,
                "friction": [friction.finger, friction.palm],
                "approach": None if request.approach is None else request.approach.as_mapping(),
                "forbidden": [region.as_mapping() for region in request.forbidden],
                "arm_identity": load_arm(arm).identity if arm else None,
                "constraint_identities": identities(settings.constraints),
                "settings": decisive,
            }
        )
