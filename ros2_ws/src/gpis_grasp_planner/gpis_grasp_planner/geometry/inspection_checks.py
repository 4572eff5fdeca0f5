"""What the inspectors of all formats share: their result, their checks, their messages."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpis_grasp_planner.errors import ErrorCode, MeshError


@dataclass(frozen=True)
class Inspection:
    """What a whole file of this content gives.

    Attributes
    ----------
    triangles : int or None
        Number of triangles after polygons are split into fans; None where only the parser
        can tell (STEP).
    ends_cleanly : bool
        False for a text without a last newline: whole, or cut in its last number.
    """

    triangles: int | None
    ends_cleanly: bool = True


def check_polygon(words: list[bytes], face: int, vertices: int, name: str) -> int:
    """Number of triangles of a polygon written as a corner count and 0-based vertex indices."""
    corners = to_integer(words[0], name, f"face {face}")
    if corners < 3 or len(words) <= corners:
        raise truncated(name, f"face {face} promises {corners} corners and names {len(words) - 1}")
    for word in words[1 : corners + 1]:
        index = to_integer(word, name, f"face {face}")
        if not 0 <= index < vertices:
            raise bad_index(name, face, index, vertices)
    return corners - 2


def check_face_count(count: int, name: str, max_faces: int) -> None:
    """Refuse a file without faces, or with more than `max_faces`."""
    if count > max_faces:
        raise MeshError(
            f"{name} has {count} faces, the limit is {max_faces}. Simplify the mesh, or raise "
            "the setting max_faces.",
            ErrorCode.MESH_TOO_LARGE,
        )
    if count <= 0:
        raise MeshError(
            f"{name} has no faces. Export it again, as triangles.", ErrorCode.MESH_EMPTY
        )


def check_finite(words: list[bytes], name: str, where: str) -> None:
    """Refuse words that are no finite numbers; `where` says which vertex they are of."""
    try:
        values = [float(w) for w in words]
    except ValueError:
        raise MeshError(f"{name}: {where} holds something else than numbers.") from None
    if not np.isfinite(values).all():
        raise MeshError(
            f"{name}: {where} is not finite. Repair the mesh and export it again.",
            ErrorCode.MESH_NOT_FINITE,
        )


def to_integer(word: bytes, name: str, where: str) -> int:
    """A word as an integer, or an error that shows it."""
    try:
        return int(word)
    except ValueError:
        shown = word[:20].decode("ascii", "replace")
        raise MeshError(f"{name}: {where} is {shown!r}, it must be an integer.") from None


def truncated(name: str, detail: str) -> MeshError:
    """The error of a file that is not whole."""
    return MeshError(f"{name} is truncated or damaged: {detail}. Export or copy it again.")


def bad_index(name: str, face: int, index: int, vertices: int) -> MeshError:
    """The error of a face (counted from 1) that uses a 0-based vertex index out of range."""
    return MeshError(
        f"{name}: face {face} uses vertex index {index}, allowed is 0 to {vertices - 1}. "
        "Export it again.",
        ErrorCode.MESH_BAD_INDEX,
    )
