"""From the bytes of a mesh file to a mesh in metres.

Readers (:mod:`formats`) give what a file holds, or refuse it; here it is scaled, one body of
several is chosen, and the result is judged as a mesh (:mod:`defects`).
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.geometry.formats.glb import read_glb
from gpis_grasp_planner.geometry.formats.obj import read_obj
from gpis_grasp_planner.geometry.formats.off import read_off
from gpis_grasp_planner.geometry.formats.parsed_cloud import CLOUD_SUFFIXES
from gpis_grasp_planner.geometry.formats.parsed_mesh import Array, Index, ParsedMesh, Piece
from gpis_grasp_planner.geometry.formats.ply import read_ply
from gpis_grasp_planner.geometry.formats.step import read_step
from gpis_grasp_planner.geometry.formats.stl import read_stl
from gpis_grasp_planner.geometry.formats.threemf import read_3mf
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.units import metres_per

READERS: dict[str, Callable[[bytes, str, int], ParsedMesh]] = {
    ".stl": read_stl,
    ".obj": read_obj,
    ".ply": read_ply,
    ".off": read_off,
    ".3mf": read_3mf,
    ".glb": read_glb,
}
STEP_SUFFIXES = (".step", ".stp")
OWN_UNIT_SUFFIXES = (*STEP_SUFFIXES, ".3mf", ".glb")
MESH_SUFFIXES = (*READERS, *STEP_SUFFIXES)
PART_SUFFIXES = (*MESH_SUFFIXES, *CLOUD_SUFFIXES)  # what a part may be read from
_SHOWN_PIECES = 20


@dataclass(frozen=True, eq=False)
class MeshReport:
    """What is known of a loaded file beside its mesh.

    Attributes
    ----------
    file_format : str
        The file's ending without the dot.
    unit : str
        The unit it was read in.
    file_sha256 : str
        Of the very bytes that were parsed.
    watertight : bool
        Closed, with a volume.
    volume : float
        [m^3]; of the convex hull where the mesh is not watertight.
    center_of_volume : (3,) array
        Centre of that volume [m].
    bodies : int
        Connected pieces.
    notes : tuple of str
        Repairs and assumptions.
    """

    file_format: str
    unit: str
    file_sha256: str
    watertight: bool
    volume: float
    center_of_volume: Array
    bodies: int
    notes: tuple[str, ...]


def load_mesh(
    path: Path,
    unit: str,
    settings: CatalogueSettings | None = None,
    *,
    scale: float = 1.0,
    body: str | int | None = None,
) -> tuple[TriangleMesh, MeshReport]:
    """Read, judge and parse a mesh file.

    Parameters
    ----------
    path : Path
        A regular file with one of the endings :data:`MESH_SUFFIXES`.
    unit : str
        One of :data:`units.UNITS`: the unit of the file's numbers. A STEP, 3MF or GLB file names
        its own unit, which counts.
    settings : CatalogueSettings, optional
        Limits; the defaults if None.
    scale : float
        The numbers are multiplied by it, whatever their unit.
    body : str or int, optional
        The name of one body of the file, or its number from 1; None for all as one part.

    Raises
    ------
    MeshError
        With the code of the defect; messages name the file without its folder.
    """
    settings = settings or CatalogueSettings()
    suffix = checked_suffix(path.name)
    data = read_regular_file(path, settings.max_file_bytes)
    return parse_mesh(data, suffix, unit, path.name, settings, scale=scale, body=body)


def checked_suffix(file_name: str) -> str:
    """The lower-case ending of a file name, or MESH_FORMAT_NOT_SUPPORTED."""
    suffix = Path(file_name).suffix.lower()
    if suffix not in PART_SUFFIXES:
        cure = "Convert it to one of these."
        if suffix == ".gltf":
            cure = "Export GLB, which holds all that a .gltf leaves in other files."
        elif suffix in (".gz", ".bz2", ".xz", ".zst", ".zip", ".7z", ".rar"):
            cure = "It is packed: unpack it."
        raise MeshError(
            f"{file_name!r} is no supported format; supported are "
            f"{', '.join(sorted(PART_SUFFIXES))}. {cure}",
            ErrorCode.MESH_FORMAT_NOT_SUPPORTED,
        )
    return suffix


def read_regular_file(path: Path, max_bytes: int) -> bytes:
    """The whole content of a regular file of at most `max_bytes`, read once.

    A FIFO or a device is refused without being opened; the size is judged before reading.
    """
    name = path.name
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise MeshError(f"{name} is not a regular file. Name a mesh file.")
        # O_NONBLOCK: had the file become a FIFO since, opening it must not hang.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as file:
            status = os.fstat(descriptor)
            if not stat.S_ISREG(status.st_mode):
                raise MeshError(f"{name} is not a regular file. Name a mesh file.")
            if status.st_size > max_bytes:
                raise _too_large(name, status.st_size, max_bytes)
            data = file.read(max_bytes + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "not a usable file name"
        raise MeshError(f"{name!r} cannot be read: {reason}.") from None
    if len(data) > max_bytes:  # it has grown since
        raise _too_large(name, len(data), max_bytes)
    if not data[:4096].strip() and not data.strip():
        raise MeshError(
            f"{name} is empty ({len(data)} bytes). Export it again.", ErrorCode.MESH_EMPTY
        )
    return data


def parse_mesh(
    data: bytes,
    suffix: str,
    unit: str,
    name: str,
    settings: CatalogueSettings,
    *,
    scale: float = 1.0,
    body: str | int | None = None,
) -> tuple[TriangleMesh, MeshReport]:
    """Judge and parse the bytes of a mesh file; see :func:`load_mesh`."""
    from gpis_grasp_planner.geometry.defects import judge  # SciPy: 40 MB that the node saves

    unit_m = metres_per(unit, name)
    parsed = _read(data, suffix, name, settings)
    notes = list(parsed.notes)
    faces = parsed.faces
    if body is not None:
        piece = _chosen(parsed, body, name)
        faces = faces[piece.first : piece.end]
        notes.append(f"Of {len(parsed.pieces)} bodies only '{piece.name}' is the part.")
    metres = scale * (1.0 if parsed.own_unit else unit_m)
    vertices, faces = _used(parsed.vertices, faces)
    judged = judge(
        vertices * metres,
        faces,
        name=name,
        unit="its own unit" if parsed.own_unit else unit,
        settings=settings,
        drop_degenerate=suffix in STEP_SUFFIXES,
    )
    if parsed.doubt and not judged.watertight:
        raise MeshError(
            f"{name} was probably not read whole: {parsed.doubt}, and its surface is open. Copy "
            f"it again, or export it again{', as STL' if suffix in STEP_SUFFIXES else ''}."
        )
    if body is None and len(parsed.pieces) > 1 and judged.bodies > 1:
        notes.append(f"Its bodies are {_list(parsed.pieces)}; choose one by 'body' or --body.")
    report = MeshReport(
        file_format=suffix[1:],
        unit="m" if parsed.own_unit else unit,
        file_sha256=hashlib.sha256(data).hexdigest(),
        watertight=judged.watertight,
        volume=judged.volume,
        center_of_volume=judged.center_of_volume,
        bodies=judged.bodies,
        notes=(*notes, *judged.notes),
    )
    return judged.mesh, report


def _read(data: bytes, suffix: str, name: str, settings: CatalogueSettings) -> ParsedMesh:
    if suffix in STEP_SUFFIXES:
        return read_step(data, name, settings.max_faces, settings.step_timeout_s)
    if suffix not in READERS:
        raise MeshError(
            f"{name} is a point cloud, not a mesh. Give a mesh file here.",
            ErrorCode.MESH_FORMAT_NOT_SUPPORTED,
        )
    try:
        return READERS[suffix](data, name, settings.max_faces)
    except MemoryError:
        raise MeshError(
            f"{name} ({len(data)} bytes) needs more memory than there is. Simplify the mesh.",
            ErrorCode.MESH_TOO_LARGE,
        ) from None


def _used(vertices: Array, faces: Index) -> tuple[Array, Index]:
    """Without vertices that no face uses: neither NaN nor a far one there says anything."""
    used = np.zeros(len(vertices), dtype=bool)
    used[faces.reshape(-1)] = True
    if used.all():
        return vertices, faces
    return vertices[used], (np.cumsum(used) - 1)[faces]


def _chosen(parsed: ParsedMesh, body: str | int, name: str) -> Piece:
    pieces = parsed.pieces or (Piece("body 1", 0, len(parsed.faces)),)
    for piece in pieces:
        if piece.name == body:
            return piece
    if str(body).isdecimal() and 1 <= int(body) <= len(pieces):
        return pieces[int(body) - 1]
    raise MeshError(
        f"{name} has no body {str(body)[:80]!r}; its bodies are {_list(pieces)}. Give a name or a "
        "number of these.",
        ErrorCode.MESH_SIDECAR_INVALID,
    )


def _list(pieces: tuple[Piece, ...]) -> str:
    shown = ", ".join(f"{i} '{p.name}'" for i, p in enumerate(pieces[:_SHOWN_PIECES], start=1))
    more = len(pieces) - _SHOWN_PIECES
    return f"{shown} and {more} more" if more > 0 else shown


def _too_large(name: str, size: int, limit: int) -> MeshError:
    return MeshError(
        f"{name} has {size} bytes, the limit is {limit}. Simplify the mesh, or raise the setting "
        "catalogue.max_file_bytes.",
        ErrorCode.MESH_TOO_LARGE,
    )
