"""Mesh IDs to parts: files of configured directories, and nothing outside them.

An ID is the path of a mesh file in its directory without the ending (``mug`` for ``mug.stl``,
``gearbox/planet`` for ``gearbox/planet.step``), or with it; where one folder holds ``mug.stl`` and
``mug.obj``, only the full names work. Of directories that know the same ID the first one counts.
The directories are listed anew at each call, so that a file put there while the node runs is
found, and a file is read once: what is parsed is what is hashed.
"""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gpis_grasp_planner.errors import ErrorCode, MeshError, RequestError
from gpis_grasp_planner.geometry.catalogue_files import (
    ID_PATTERN,
    CatalogueFile,
    files_of,
    is_inside,
    refused_files,
    with_id,
)
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.geometry.cloud_file import is_cloud, parse_cloud
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.mesh_file import (
    OWN_UNIT_SUFFIXES,
    MeshReport,
    checked_suffix,
    parse_mesh,
    read_regular_file,
)
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.sidecar import MAX_SIDECAR_BYTES, Sidecar, parse_sidecar
from gpis_grasp_planner.geometry.symmetry import SymmetryGroup
from gpis_grasp_planner.geometry.units import UNITS, same_unit, unit_advice

__all__ = [
    "ID_PATTERN",
    "CatalogueSettings",
    "MeshCatalogue",
    "default_catalogue_directory",
    "load_part",
]

SIDECAR_SUFFIXES = (".yaml", ".yml")
NEAREST_IDS = 5


def default_catalogue_directory() -> Path:
    """The directory of the meshes that ship with the package."""
    return Path(__file__).resolve().parent / "parts" / "meshes"


class MeshCatalogue:
    """The parts that may be asked for by ID.

    Parameters
    ----------
    directories : sequence of Path
        Searched in this order, with their subdirectories; links to directories are not followed.
    settings : CatalogueSettings, optional
        Limits and defaults.

    Raises
    ------
    RequestError
        INVALID_SETTING if there is none, or one is no directory.
    """

    def __init__(
        self, directories: Sequence[Path], settings: CatalogueSettings | None = None
    ) -> None:
        if not directories:
            raise RequestError("The mesh catalogue has no directory; configure at least one.")
        for directory in directories:
            if not Path(directory).is_dir():
                raise RequestError(
                    f"The catalogue directory {str(directory)!r} does not exist or is no "
                    "directory. Create it or configure another."
                )
        self._directories = tuple(Path(d).resolve() for d in directories)
        self.settings = settings or CatalogueSettings()

    def ids(self) -> list[str]:
        """All IDs that :meth:`load` would look up, sorted; full names only where stems clash."""
        found: dict[str, None] = {}
        for directory in self._directories:
            stems: dict[str, list[CatalogueFile]] = {}
            for file in files_of(directory):
                stems.setdefault(file.stem, []).append(file)
            for stem, files in stems.items():
                if stem not in found:
                    names = [stem] if len(files) == 1 else [f.name for f in files]
                    found.update(dict.fromkeys(names))
        return sorted(found)

    def refused(self) -> list[tuple[str, str]]:
        """Mesh files that no ID can name, as (path in the directory, reason and cure); sorted."""
        return sorted({file for d in self._directories for file in refused_files(d)})

    def load(self, mesh_id: str) -> Part:
        """Read, judge and return the part of an ID.

        Raises
        ------
        RequestError
            INVALID_MESH_ID or UNKNOWN_MESH; messages name IDs, never paths.
        MeshError
            With the code of the defect of the file or its sidecar.
        """
        if ID_PATTERN.fullmatch(mesh_id) is None:
            raise RequestError(
                f"Mesh ID {_shown(mesh_id)} is not allowed: an ID has 1 to 64 letters, digits, "
                "'_', '-' or single '.', and starts with a letter or digit; '/' stands before the "
                f"name in a folder. {self._there_all_the_same(mesh_id)}",
                ErrorCode.INVALID_MESH_ID,
            )
        directory, path = self._find(mesh_id)
        part = _load(path, mesh_id, None, self.settings, inside=directory)
        others = [d for d in self._directories if d != directory and with_id(d, mesh_id)]
        if others:
            note = f"{len(others)} later catalogue directories also hold '{mesh_id}'; not used."
            part = replace(part, notes=(*part.notes, note))
        return part

    def sidecar(self, mesh_id: str) -> Sidecar:
        """What the YAML file beside the mesh of an ID says, without reading the mesh.

        Raises
        ------
        RequestError, MeshError
            As :meth:`load` does for the ID and the YAML file.
        """
        directory, path = self._find(mesh_id)
        return _read_sidecar(path, mesh_id, directory)

    def plain_file(self, mesh_id: str) -> tuple[Path, float] | None:
        """The file of an ID with its metres per unit; None where others cannot show it as it is.

        They can show STL and OBJ files of one body.

        Raises
        ------
        RequestError, MeshError
            As :meth:`sidecar`.
        """
        directory, path = self._find(mesh_id)
        sidecar = _read_sidecar(path, mesh_id, directory)
        if path.suffix.lower() not in {".stl", ".obj"} or sidecar.body is not None:
            return None
        unit = UNITS[sidecar.unit or self.settings.default_unit]
        return path, unit * (sidecar.scale or 1.0)

    def file_of(self, mesh_id: str) -> Path:
        """The file of an ID; raises as :meth:`sidecar` does."""
        return self._find(mesh_id)[1]

    def _find(self, mesh_id: str) -> tuple[Path, Path]:
        for directory in self._directories:
            files = with_id(directory, mesh_id)
            exact = [f for f in files if f.name == mesh_id]
            if exact or len(files) == 1:
                return directory, _inside((exact or files)[0].path, directory, mesh_id)
            if files:
                names = ", ".join(f.name for f in files)
                raise RequestError(
                    f"Mesh ID '{mesh_id}' is ambiguous; ask for one of {names}.",
                    ErrorCode.UNKNOWN_MESH,
                )
        # A supported name with an ending that is not, such as 'gear.iges'.
        for name, reason in self.refused():
            if mesh_id in (name, name.rpartition(".")[0]):
                raise RequestError(
                    f"Mesh ID '{mesh_id}' has a file, but {reason}.", ErrorCode.UNKNOWN_MESH
                )
        known = self.ids()
        raise RequestError(
            f"Mesh ID '{mesh_id}' is unknown. {_advice(mesh_id, known)}", ErrorCode.UNKNOWN_MESH
        )

    def _there_all_the_same(self, mesh_id: str) -> str:
        for name, reason in self.refused():
            if len(mesh_id) < 200 and mesh_id in (name, name.rpartition(".")[0]):
                return f"A file of that name is there, but {reason}."
        return "Use an ID of the catalogue."


def load_part(
    path: Path,
    unit: str | None = None,
    settings: CatalogueSettings | None = None,
    *,
    body: str | int | None = None,
) -> Part:
    """Load a plain mesh file, outside any catalogue; its ID is the stem of its name.

    Parameters
    ----------
    path : Path
    unit : str, optional
        One of `units.UNITS`. Overrules the sidecar; None takes the sidecar's, then the default of
        the settings.
    settings : CatalogueSettings, optional
    body : str or int, optional
        The name or the number (from 1) of the one body of the file that is the part. Overrules
        the sidecar.

    Raises
    ------
    MeshError
        With the code of the defect.
    """
    path = Path(path)
    return _load(path, path.stem, unit, settings or CatalogueSettings(), body=body)


def _load(
    path: Path,
    mesh_id: str,
    unit: str | None,
    settings: CatalogueSettings,
    inside: Path | None = None,
    body: str | int | None = None,
) -> Part:
    suffix = checked_suffix(path.name)
    notes: list[str] = []
    # The mesh first: a missing file should not be reported as a lack of units.
    data = read_regular_file(path, settings.max_file_bytes)
    sidecar = _read_sidecar(path, mesh_id, inside)
    stated = unit or sidecar.unit
    if suffix in OWN_UNIT_SUFFIXES:
        if stated is not None:
            notes.append(
                f"The unit '{stated}' was not used: a {suffix[1:].upper()} file names its own."
            )
    elif stated is None:
        notes.append(
            f"No unit given: read in the default unit '{settings.default_unit}'; where it is "
            f"another, {unit_advice('mm' if settings.default_unit == 'm' else 'm')}."
        )
    elif sidecar.unit is not None and not same_unit(sidecar.unit, stated):
        notes.append(f"Unit '{stated}' as asked, though its YAML file says '{sidecar.unit}'.")
    read_as = stated or settings.default_unit
    scale = sidecar.scale or 1.0
    body = sidecar.body if body is None else body
    uncertainty = None
    if is_cloud(data, suffix, path.name):
        _refuse_body(body, path.name)
        mesh, report, uncertainty = parse_cloud(
            data, suffix, read_as, path.name, settings,
            scale=scale, viewpoints_m=sidecar.viewpoints,
        )  # fmt: skip
    else:
        mesh, report = parse_mesh(
            data, suffix, read_as, path.name, settings, scale=scale, body=body
        )
    if sidecar.scale is not None:
        notes.append(f"Scaled by {sidecar.scale:g} as its YAML file says.")
    part = _part(mesh_id, mesh, report, sidecar, settings, notes)
    return part if uncertainty is None else replace(part, uncertainty=uncertainty)


def _refuse_body(body: str | int | None, name: str) -> None:
    if body is not None:
        raise MeshError(
            f"{name} is a point cloud, which has no bodies to choose from ({str(body)[:80]!r} was "
            "asked for). Leave the body out.",
            ErrorCode.MESH_SIDECAR_INVALID,
        )


def _part(
    mesh_id: str,
    mesh: TriangleMesh,
    report: MeshReport,
    sidecar: Sidecar,
    settings: CatalogueSettings,
    notes: list[str],
) -> Part:
    center = report.center_of_volume
    if sidecar.center_of_mass is not None:
        center = sidecar.center_of_mass
        low, high = mesh.bounds - 0.5 * np.array([[1.0], [-1.0]]) * mesh.extent
        if not ((center >= low) & (center <= high)).all():
            raise MeshError(
                f"The center_of_mass {center.tolist()} of '{mesh_id}' lies far outside the mesh "
                f"({mesh.bounds[0].round(4).tolist()} to {mesh.bounds[1].round(4).tolist()} m). "
                "It is in metres, in the mesh file's frame.",
                ErrorCode.MESH_SIDECAR_INVALID,
            )
    if sidecar.symmetry is not None:
        _check_symmetry(mesh_id, mesh, sidecar.symmetry)
    mass = sidecar.mass
    assumed = mass is None and sidecar.density is None
    if mass is None:
        density = sidecar.density
        if density is None:
            density = settings.default_density_kg_m3
            notes.append(f"No mass or density given: {density:g} kg/m3 assumed.")
        mass = density * report.volume
    simplified, apart_m = None, 0.0
    if len(mesh.faces) > settings.simplify_above_faces:
        simplified, apart_m = _simplified(mesh, notes)
    return Part(
        mesh_id=mesh_id,
        mesh=mesh,
        center_of_mass=center,
        mass=mass,
        volume=report.volume,
        watertight=report.watertight,
        friction=sidecar.friction,
        notes=(*report.notes, *notes),
        simplified=simplified,
        simplified_apart_m=apart_m,
        mass_assumed=assumed,
    )


def _check_symmetry(mesh_id: str, mesh: TriangleMesh, symmetry: SymmetryGroup) -> None:
    off, limit = symmetry.deviation(mesh)
    if off > limit:
        raise MeshError(
            f"The symmetries that the YAML file of '{mesh_id}' declares are not those of the mesh: "
            f"turned by them it stands out of itself by {1e3 * off:.2g} mm, the limit is "
            f"{1e3 * limit:.2g} mm. Check axis, order and point (in metres, in the mesh file's "
            "frame).",
            ErrorCode.MESH_SIDECAR_INVALID,
        )


def _simplified(mesh: TriangleMesh, notes: list[str]) -> tuple[TriangleMesh | None, float]:
    from gpis_grasp_planner.geometry.simplification import simplify  # what the node saves

    found = simplify(mesh)
    if found is None:
        return None, 0.0
    notes.append(
        f"Its {len(mesh.faces)} faces were simplified to {len(found.mesh.faces)} for search and "
        f"physics ({1e3 * found.deviation:.2g} mm apart at most, of 10000 points); contacts are "
        "decided on all of them."
    )
    return found.mesh, found.deviation


def _read_sidecar(path: Path, mesh_id: str, inside: Path | None) -> Sidecar:
    names = [base + s for base in (path.name, path.stem) for s in SIDECAR_SUFFIXES]
    found = [p for p in (path.with_name(n) for n in names) if p.exists() or p.is_symlink()]
    if len(found) > 1:
        raise MeshError(
            f"Mesh '{mesh_id}' has several YAML files ({', '.join(p.name for p in found)}). "
            "Keep one.",
            ErrorCode.MESH_SIDECAR_INVALID,
        )
    if not found:
        return Sidecar()
    if inside is not None:
        _inside(found[0], inside, mesh_id)
    try:
        data = read_regular_file(found[0], MAX_SIDECAR_BYTES)
    except MeshError as error:
        if error.code == ErrorCode.MESH_EMPTY:
            return Sidecar()
        raise MeshError(str(error), ErrorCode.MESH_SIDECAR_INVALID) from None
    return parse_sidecar(data, found[0].name)


def _inside(path: Path, directory: Path, mesh_id: str) -> Path:
    if not is_inside(path, directory):
        raise RequestError(
            f"Mesh ID '{mesh_id}' does not name a regular file inside the catalogue (a link out "
            "of it, a pipe or a device). Put the file itself there.",
            ErrorCode.INVALID_MESH_ID,
        )
    return path


def _advice(mesh_id: str, known: list[str]) -> str:
    if not known:
        return "The catalogue is empty: put mesh files into its directory."
    folded = {k.lower(): k for k in known}
    near = [
        folded[m]
        for m in difflib.get_close_matches(mesh_id.lower(), folded, NEAREST_IDS, cutoff=0.4)
    ]
    near += [k for k in known if k not in near and mesh_id.lower() in k.lower()]
    if near:
        return f"Nearest known IDs: {', '.join(near[:NEAREST_IDS])}."
    more = "" if len(known) <= 10 else f" and {len(known) - 10} more"
    return f"Known IDs: {', '.join(known[:10])}{more}."


def _shown(mesh_id: object) -> str:
    text = ascii(mesh_id)
    return text if len(text) <= 80 else f"{text[:76]}...'"
