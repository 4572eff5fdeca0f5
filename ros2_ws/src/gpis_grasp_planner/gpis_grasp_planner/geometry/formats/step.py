"""STEP by OpenCASCADE, in a process of its own, held against what the text promises."""

from __future__ import annotations

import re
import subprocess
import sys
import time

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.extras import how_to_install, is_installed
from gpis_grasp_planner.geometry.formats.glb import GlbBody, glb_bodies, joined
from gpis_grasp_planner.geometry.formats.parsed_mesh import (
    Array,
    Index,
    ParsedMesh,
)
from gpis_grasp_planner.geometry.formats.step_text import StepPromise, read_promise

TOLERANCE_MM = 0.1
TOLERANCE_RAD = 0.2
COARSE_RAD = 0.5  # with which OpenCASCADE splits faces that it fails at with the finer one
MEMORY_BYTES = 4 * 2**30

# The whole program of the process that reads STEP. OpenCASCADE prints to the standard output,
# which is kept for the result; cascadio does without trimesh, which takes two seconds to import.
# One primitive a face: so that missing faces can be counted.
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
                           tol_angular=angular, use_parallel=False, merge_primitives=False))
result.flush()
os._exit(0)  # not through destructors of shapes that may be damaged
"""
_SYNTAX_ERRORS = re.compile(rb"Incorrect Syntax\s*:\s*Fails Count\s*:\s*(\d+)")


def read_step(data: bytes, name: str, max_faces: int, timeout_s: float) -> ParsedMesh:
    """Tessellate a STEP file; OpenCASCADE converts its own unit to metres.

    A damaged STEP file can crash OpenCASCADE, so it works in a process of its own, with a limit
    on time and memory; starting that takes about half a second.

    Raises
    ------
    MeshError
        MESH_FORMAT_NOT_SUPPORTED where cascadio is not installed; MESH_UNREADABLE where the
        shape has fewer faces than the text, and is open or lacks as many as a whole shell has.
    """
    if not is_installed("cascadio"):
        raise MeshError(
            how_to_install(f"Reading {name}", "cascadio", "step"),
            ErrorCode.MESH_FORMAT_NOT_SUPPORTED,
        )
    promise = read_promise(data, name)
    started = time.monotonic()
    glb, messages = _tessellate(promise.body, name, timeout_s, TOLERANCE_RAD)
    try:
        bodies, _ = glb_bodies(glb, name, max_faces)
    except MeshError as error:
        if glb and error.code != ErrorCode.MESH_EMPTY:
            raise
        raise _no_shape(promise, name) from None
    notes = []
    read = _distinct_faces(bodies)
    left_s = timeout_s - (time.monotonic() - started)
    if read < promise.faces and left_s > 0.0:
        coarse = _coarse(promise, name, max_faces, left_s)
        if _distinct_faces(coarse) > read:
            notes.append(
                f"OpenCASCADE loses {promise.faces - read} of {promise.faces} faces at "
                f"{TOLERANCE_RAD} rad; read at {COARSE_RAD} rad, within {TOLERANCE_MM} mm as ever."
            )
            bodies, read = coarse, _distinct_faces(coarse)
    missing = promise.faces - read
    syntax_errors = sum(int(n) for n in _SYNTAX_ERRORS.findall(messages))
    lost = promise.closed_faces - read >= max(promise.smallest_shell, 1)
    few = len(bodies) < promise.parts
    if lost or promise.missing_shells or (few and syntax_errors):
        raise MeshError(
            f"{name} is damaged: OpenCASCADE reads {read} of {promise.faces} "
            f"faces and {len(bodies)} of {promise.parts} parts. Export it again, or as STL."
        )
    doubt = None
    if syntax_errors:
        doubt = f"OpenCASCADE finds {syntax_errors} errors of syntax in it"
        notes.append(f"OpenCASCADE finds {syntax_errors} errors of syntax in the file.")
    if missing > 0:
        doubt = f"OpenCASCADE reads {read} of its {promise.faces} faces"
        notes.append(f"OpenCASCADE reads {read} of {promise.faces} faces.")
    if few:
        notes.append(f"Only {len(bodies)} of {promise.parts} placed parts have a shape.")
    if promise.solids == 0:
        notes.append("It holds surfaces without a solid; export a solid if the part is one.")
    if promise.after_the_end:
        notes.append(f"{promise.after_the_end} bytes after the end of the STEP text were ignored.")
    return joined(_apart(bodies, promise), tuple(notes), doubt)


def _coarse(promise: StepPromise, name: str, max_faces: int, timeout_s: float) -> list[GlbBody]:
    """The bodies with coarser angles; none where that fails, since there is a shape already."""
    try:
        glb, _ = _tessellate(promise.body, name, timeout_s, COARSE_RAD)
        return glb_bodies(glb, name, max_faces)[0]
    except MeshError:
        return []


def _tessellate(body: bytes, name: str, timeout_s: float, angle_rad: float) -> tuple[bytes, bytes]:
    arguments = [str(TOLERANCE_MM), str(angle_rad), str(MEMORY_BYTES)]
    try:
        child = subprocess.run(
            [sys.executable, "-c", TESSELLATE, *arguments],
            input=body,
            capture_output=True,
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise MeshError(
            f"{name} was not tessellated within {timeout_s:g} s. Simplify it, or convert it to "
            "STL, or raise the setting catalogue.step_timeout_s."
        ) from None
    if child.returncode != 0:
        raise MeshError(
            f"{name} holds no shape that OpenCASCADE can read (its exit code was "
            f"{child.returncode}). It is damaged; export it again, or convert it to STL."
        )
    return child.stdout, child.stderr


def _no_shape(promise: StepPromise, name: str) -> MeshError:
    if promise.faces == 0 and promise.solids == 0:
        what = "only curves (a wireframe)" if promise.curves else "no solid and no face"
        return MeshError(
            f"{name} holds {what}, which is no part to be grasped. Export a solid.",
            ErrorCode.MESH_EMPTY,
        )
    return MeshError(
        f"{name} holds no shape that OpenCASCADE can read, though it declares {promise.solids} "
        f"solids and {promise.faces} faces. It is damaged; export it again, or convert it to STL."
    )


def _distinct_faces(bodies: list[GlbBody]) -> int:
    """Faces with triangles; those of a part that is placed several times count once."""
    faces_of = {body.source: len(body.primitives) for body in bodies}
    return sum(faces_of.values())


def _apart(bodies: list[GlbBody], promise: StepPromise) -> list[GlbBody]:
    """Solids of one part that has several, where pieces and solids agree in number."""
    if len(bodies) != 1 or promise.solids < 2 or promise.has_voids:
        return bodies
    [body] = bodies
    owner: dict[bytes, int] = {}
    root = list(range(len(body.primitives)))

    def find(i: int) -> int:
        while root[i] != i:
            i = root[i]
        return i

    for i, (points, _) in enumerate(body.primitives):
        for point in (points + 0.0).astype("<f4"):
            first = owner.setdefault(point.tobytes(), i)
            root[find(i)] = find(first)
    groups: dict[int, list[tuple[Array, Index]]] = {}
    for i, primitive in enumerate(body.primitives):
        groups.setdefault(find(i), []).append(primitive)
    if len(groups) != promise.solids:
        return bodies
    return [GlbBody(body.name, group, body.source) for group in groups.values()]
