"""From the bytes of a mesh file to a mesh in metres; the only importer of trimesh.

The bytes are judged first (:mod:`file_inspection`), then parsed, then held against what the
inspection promised, then judged as a mesh (:mod:`defects`): the parser is trusted with nothing.
"""

from __future__ import annotations

import hashlib
import io
import logging
import os
import stat
import subprocess
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.geometry.file_inspection import INSPECTORS, inspect
from gpis_grasp_planner.geometry.inspection_checks import Inspection
from gpis_grasp_planner.geometry.mesh import TriangleMesh

Array = NDArray[np.float64]

UNITS = {"m": 1.0, "mm": 1e-3}
STEP_SUFFIXES = (".step", ".stp")
STEP_TOLERANCE_MM = 0.1
STEP_TOLERANCE_RAD = 0.2
STEP_MEMORY_BYTES = 4 * 2**30

# The whole program of the process that reads STEP. OpenCASCADE prints to the standard output,
# which is kept for the result; cascadio does without trimesh, which takes two seconds to import.
TESSELLATE = """
import os, resource, sys
result = os.fdopen(os.dup(1), "wb")
os.dup2(2, 1)
linear, angular, memory = float(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3])
resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
sys.modules["trimesh"] = None
import cascadio
result.write(cascadio.load(sys.stdin.buffer.read(), file_type="step", tol_linear=linear,
                           tol_angular=angular, use_parallel=False))
result.flush()
os._exit(0)  # not through destructors of shapes that may be damaged
"""


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
    path: Path, unit: str, settings: CatalogueSettings | None = None
) -> tuple[TriangleMesh, MeshReport]:
    """Read, judge and parse a mesh file.

    Parameters
    ----------
    path : Path
        A regular file ending in .stl, .obj, .ply, .off, .step or .stp.
    unit : str
        'm' or 'mm': the unit of the file's numbers. A STEP file names its own unit, which counts.
    settings : CatalogueSettings, optional
        Limits; the defaults if None.

    Raises
    ------
    MeshError
        With the code of the defect; messages name the file without its folder.
    """
    settings = settings or CatalogueSettings()
    suffix = checked_suffix(path.name)
    data = read_regular_file(path, settings.max_file_bytes)
    return parse_mesh(data, suffix, unit, path.name, settings)


def checked_suffix(file_name: str) -> str:
    """The lower-case ending of a file name, or MESH_FORMAT_NOT_SUPPORTED."""
    suffix = Path(file_name).suffix.lower()
    if suffix not in INSPECTORS:
        raise MeshError(
            f"{file_name!r} is no supported mesh format; supported are "
            f"{', '.join(sorted(INSPECTORS))}. Convert it to one of these.",
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
    if not data.strip():
        raise MeshError(
            f"{name} is empty ({len(data)} bytes). Export it again.", ErrorCode.MESH_EMPTY
        )
    return data


def parse_mesh(
    data: bytes, suffix: str, unit: str, name: str, settings: CatalogueSettings
) -> tuple[TriangleMesh, MeshReport]:
    """Judge and parse the bytes of a mesh file; see :func:`load_mesh`."""
    from gpis_grasp_planner.geometry.defects import judge  # SciPy: 40 MB that the node saves

    if unit not in UNITS:
        raise MeshError(
            f"{name}: the unit is {unit!r}; it must be 'm' or 'mm'.", ErrorCode.MESH_SIDECAR_INVALID
        )
    promise = inspect(data, suffix, name, settings.max_faces)
    is_step = suffix in STEP_SUFFIXES
    vertices, faces = _parse_step(data, name, settings) if is_step else _parse(data, suffix, name)
    _check_promise(promise, faces, name, settings.max_faces)
    scale = 1.0 if is_step else UNITS[unit]
    judged = judge(
        vertices * scale,
        faces,
        name=name,
        unit="its own unit" if is_step else unit,
        settings=settings,
        drop_degenerate=is_step,
    )
    if not promise.ends_cleanly and not judged.watertight:
        raise MeshError(
            f"{name} ends without a newline and its surface is open: it is probably truncated. "
            "Export or copy it again; if it is whole, end its last line."
        )
    report = MeshReport(
        file_format=suffix[1:],
        unit="m" if is_step else unit,
        file_sha256=hashlib.sha256(data).hexdigest(),
        watertight=judged.watertight,
        volume=judged.volume,
        center_of_volume=judged.center_of_volume,
        bodies=judged.bodies,
        notes=judged.notes,
    )
    return judged.mesh, report


def _parse(data: bytes, suffix: str, name: str) -> tuple[Array, NDArray[np.int64]]:
    import trimesh

    # It logs the tracebacks of what it tried first; what comes of it is judged here.
    logging.getLogger("trimesh").setLevel(logging.CRITICAL)
    # Materials would make it look for further files; processing would hide defects.
    options: dict[str, Any] = {"process": False, "maintain_order": True}
    if suffix == ".obj":
        options["skip_materials"] = True
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # of texture coordinates, not used
            loaded: Any = trimesh.load(
                io.BytesIO(data), file_type=suffix[1:], force="mesh", resolver=None, **options
            )
        return (
            np.array(loaded.vertices, dtype=np.float64).reshape(-1, 3),
            np.array(loaded.faces, dtype=np.int64).reshape(-1, 3),
        )
    except Exception as error:  # a parser fed with foreign bytes may raise anything
        raise _not_parsed(name, error) from error


def _parse_step(
    data: bytes, name: str, settings: CatalogueSettings
) -> tuple[Array, NDArray[np.int64]]:
    """Tessellate a STEP file; OpenCASCADE converts its own unit to metres.

    A damaged STEP file can crash OpenCASCADE, so it works in a process of its own, with a limit
    on time and memory; starting that takes about half a second.
    """
    import trimesh

    arguments = [str(STEP_TOLERANCE_MM), str(STEP_TOLERANCE_RAD), str(STEP_MEMORY_BYTES)]
    try:
        child = subprocess.run(
            [sys.executable, "-c", TESSELLATE, *arguments],
            input=data,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=settings.step_timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise MeshError(
            f"{name} was not tessellated within {settings.step_timeout_s:g} s. Simplify it, or "
            "convert it to STL, or raise the setting step_timeout_s."
        ) from None
    if child.returncode != 0 or not child.stdout:
        raise MeshError(
            f"{name} holds no shape that OpenCASCADE can read (its exit code was "
            f"{child.returncode}). It is damaged; export it again, or convert it to STL."
        )
    try:
        scene: Any = trimesh.load(io.BytesIO(child.stdout), file_type="glb", force="scene")
        mesh = scene.to_mesh()
        return np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64)
    except Exception as error:
        raise _not_parsed(name, error) from error


def _check_promise(
    promise: Inspection, faces: NDArray[np.int64], name: str, max_faces: int
) -> None:
    if promise.triangles is not None and len(faces) != promise.triangles:
        raise MeshError(
            f"{name}: {promise.triangles} triangles were expected and {len(faces)} were read. "
            "The file is damaged or of an unusual kind; export it again."
        )
    if len(faces) > max_faces:
        raise MeshError(
            f"{name} has {len(faces)} faces, the limit is {max_faces}. Simplify the mesh, or "
            "raise the setting max_faces.",
            ErrorCode.MESH_TOO_LARGE,
        )


def _not_parsed(name: str, error: Exception) -> MeshError:
    return MeshError(
        f"{name} cannot be parsed ({type(error).__name__}). It is damaged or not what its "
        "ending says; export it again."
    )


def _too_large(name: str, size: int, limit: int) -> MeshError:
    return MeshError(
        f"{name} has {size} bytes, the limit is {limit}. Simplify the mesh, or raise the setting "
        "max_file_bytes.",
        ErrorCode.MESH_TOO_LARGE,
    )
