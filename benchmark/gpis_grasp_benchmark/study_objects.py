"""The objects of a success study: catalogues and PyBullet's models, in named sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gpis_grasp_benchmark import reference
from gpis_grasp_benchmark.bullet_objects import Refusal, bullet_objects
from gpis_grasp_benchmark.objects import load_objects
from gpis_grasp_planner.errors import ErrorCode, MeshError, RequestError
from gpis_grasp_planner.geometry.catalogue import (
    CatalogueSettings,
    MeshCatalogue,
    default_catalogue_directory,
)
from gpis_grasp_planner.geometry.part import Part

SHIPPED = "shipped"
_SHIPPED_SET = "shipped parts"
_ORIGINAL_SET = "original simulator"


@dataclass(frozen=True, eq=False)
class StudyObjects:
    """What a study is made on.

    Attributes
    ----------
    parts : mapping
        By an ID that is unique over all sets.
    set_of : mapping
        Name of the set by that ID.
    refused : tuple of Refusal
        Meshes that were not accepted: they count as objects, too.
    """

    parts: Mapping[str, Part]
    set_of: Mapping[str, str]
    refused: tuple[Refusal, ...]


def collect(
    directories: Sequence[Path],
    mesh_ids: Sequence[str] = (),
    facts: Mapping[str, Mapping[str, Any]] | None = None,
    n_bullet: int | None = None,
    seed: int = 0,
    settings: CatalogueSettings | None = None,
) -> StudyObjects:
    """Load all objects of a study.

    Parameters
    ----------
    directories : sequence of Path
        Of meshes, one set each; 'shipped' stands for the shipped parts.
    mesh_ids : sequence of str
        Only these objects of all the sets; default: all.
    facts : mapping, optional
        By mesh ID, for the original simulator's objects (by name and size) and for no others.
    n_bullet : int, optional
        Random parts of PyBullet's data package, with all of its household objects; None: neither.
    seed : int
        Of PyBullet's objects.
    settings : CatalogueSettings, optional

    Raises
    ------
    RequestError
        For an unknown ID or a directory that is not there.
    """
    members: list[tuple[str, Part]] = []
    refused: list[Refusal] = []
    for directory in directories:
        found, bad = _of_directory(directory, facts or {}, settings)
        members += found
        refused += bad
    if n_bullet is not None:
        bullet, bad = bullet_objects(n_bullet, seed, settings)
        members += [(name, part) for name, parts in bullet.items() for part in parts]
        refused += bad
    parts: dict[str, Part] = {}
    set_of: dict[str, str] = {}
    for object_set, part in members:
        clash = part.mesh_id in parts
        object_id = f"{_slug(object_set)}-{part.mesh_id}" if clash else part.mesh_id
        parts[object_id] = part
        set_of[object_id] = object_set
    if mesh_ids:
        known = {*parts, *(refusal.object_id for refusal in refused)}
        unknown = sorted(set(mesh_ids) - known)
        if unknown:
            raise RequestError(
                f"Unknown objects {', '.join(unknown)}; the sets hold {', '.join(sorted(known))}.",
                ErrorCode.UNKNOWN_MESH,
            )
        parts = {object_id: parts[object_id] for object_id in parts if object_id in mesh_ids}
        refused = [refusal for refusal in refused if refusal.object_id in mesh_ids]
    if not parts and not refused:
        raise RequestError("There is no mesh to study; name a directory that holds some.")
    return StudyObjects(parts, {name: set_of[name] for name in parts}, tuple(refused))


def _of_directory(
    directory: Path, facts: Mapping[str, Mapping[str, Any]], settings: CatalogueSettings | None
) -> tuple[list[tuple[str, Part]], list[Refusal]]:
    shipped = str(directory) == SHIPPED and not directory.is_dir()
    catalogue = MeshCatalogue([default_catalogue_directory() if shipped else directory], settings)
    name = _SHIPPED_SET if shipped else directory.resolve().name
    parts: list[tuple[str, Part]] = []
    refused: list[Refusal] = []
    for mesh_id in catalogue.ids():
        try:
            part = catalogue.load(mesh_id)
        except MeshError as error:
            refused.append(Refusal(mesh_id, name, str(error)))
            continue
        original = reference.is_original(mesh_id, tuple(part.mesh.extent))
        if original and mesh_id in facts:
            part = load_objects(catalogue, [mesh_id], {mesh_id: facts[mesh_id]})[mesh_id]
        parts.append((_ORIGINAL_SET if original else name, replace(part, mesh_id=mesh_id)))
    return parts, refused


def _slug(text: str) -> str:
    return text.lower().replace(" ", "-")
