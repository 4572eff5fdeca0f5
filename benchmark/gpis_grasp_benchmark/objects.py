"""The objects of a benchmark: meshes of a catalogue, with facts that their files do not hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.sidecar import parse_sidecar

_ALLOWED = {"mass", "center_of_mass", "friction", "material", "density"}


def load_objects(
    catalogue: MeshCatalogue,
    mesh_ids: Sequence[str] = (),
    facts: Mapping[str, Mapping[str, Any]] | None = None,
) -> dict[str, Part]:
    """Load the parts of a benchmark by ID.

    Parameters
    ----------
    catalogue : MeshCatalogue
    mesh_ids : sequence of str
        Default: all of the catalogue.
    facts : mapping, optional
        By mesh ID: what a YAML file beside the mesh could say (mass, centre of mass, friction).
        It goes over what such a file says.
    """
    parts = {}
    for mesh_id in mesh_ids or catalogue.ids():
        part = catalogue.load(mesh_id)
        known = (facts or {}).get(mesh_id)
        parts[mesh_id] = part if known is None else _with_facts(part, known)
    if not parts:
        raise RequestError("There is no mesh to measure on; name a directory that holds some.")
    return parts


def read_facts(path: Path) -> dict[str, dict[str, Any]]:
    """Read facts by mesh ID from a YAML file.

    Raises
    ------
    RequestError
        INVALID_SETTING if the file is not of that form.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError):
        raise RequestError(f"{path} is not valid YAML.") from None
    if not isinstance(content, Mapping) or not all(
        isinstance(v, Mapping) for v in content.values()
    ):
        raise RequestError(
            f"{path} must hold mesh IDs with their facts, such as 'mug: {{mass: 0.2}}'."
        )
    return {str(mesh_id): dict(facts) for mesh_id, facts in content.items()}


def _with_facts(part: Part, facts: Mapping[str, Any]) -> Part:
    unknown = sorted(set(facts) - _ALLOWED)
    if unknown:
        raise RequestError(
            f"Unknown fact {', '.join(unknown)} of '{part.mesh_id}'; known are "
            f"{', '.join(sorted(_ALLOWED))}."
        )
    said = parse_sidecar(yaml.safe_dump(dict(facts)).encode(), f"the facts of {part.mesh_id}")
    mass = said.mass if said.mass is not None else part.mass
    if said.mass is None and said.density is not None:
        mass = said.density * part.volume
    center = part.center_of_mass if said.center_of_mass is None else said.center_of_mass
    return replace(part, mass=mass, center_of_mass=center, friction=said.friction or part.friction)
