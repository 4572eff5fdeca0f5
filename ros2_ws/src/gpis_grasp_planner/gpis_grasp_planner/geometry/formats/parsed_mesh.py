"""What every reader of a mesh file gives, the checks they share, and their messages.

Faces are counted from 1 in messages, as OBJ does.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, MeshError

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Piece:
    """A named body, object or solid of a file: its faces `first` to `end` (excluded)."""

    name: str
    first: int
    end: int


@dataclass(frozen=True, eq=False)
class ParsedMesh:
    """A mesh as its file has it, before it is judged.

    Attributes
    ----------
    vertices : (n, 3) array
        In the file's own numbers, or in metres where the file names its unit.
    faces : (m, 3) int array
        In the order of the file; indices are checked.
    own_unit : str or None
        The unit that the file itself names (its vertices are then in metres); None where it
        names none.
    notes : tuple of str
        What was passed over or assumed.
    doubt : str or None
        Why the file may not be whole. It counts only if the surface turns out to be open.
    pieces : tuple of Piece
        Bodies that one may choose from; empty where the file has only one.
    """

    vertices: Array
    faces: Index
    own_unit: str | None = None
    notes: tuple[str, ...] = ()
    doubt: str | None = None
    pieces: tuple[Piece, ...] = field(default=())


def check_face_count(count: int, name: str, max_faces: int) -> None:
    """Refuse a file without faces, or with more than `max_faces`."""
    if count > max_faces:
        raise MeshError(
            f"{name} has {count} faces, the limit is {max_faces}. Simplify the mesh, or raise "
            "the setting catalogue.max_faces.",
            ErrorCode.MESH_TOO_LARGE,
        )
    if count <= 0:
        raise MeshError(
            f"{name} has no faces. Export it again, as triangles.", ErrorCode.MESH_EMPTY
        )


def check_finite(vertices: Array, name: str) -> None:
    """Refuse vertices that are not finite; the message names the first."""
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if bad.size:
        raise MeshError(
            f"{name}: vertex {bad[0] + 1} is not finite ({bad.size} such vertices of "
            f"{len(vertices)}). Repair the mesh and export it again.",
            ErrorCode.MESH_NOT_FINITE,
        )


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


def named_pieces(names: list[tuple[str, int]], n_faces: int) -> tuple[Piece, ...]:
    """Pieces from names and their first faces, in order; those without faces are left out.

    Names that are missing or used twice are told apart by a number.
    """
    ends = [first for _, first in names[1:]] + ([n_faces] if names else [])
    found = [(n, first, end) for (n, first), end in zip(names, ends, strict=True) if end > first]
    if len(found) < 2:
        return ()
    seen: dict[str, int] = {}
    pieces = []
    for number, (text, first, end) in enumerate(found, start=1):
        shown = (
            "".join(c if c.isprintable() else "?" for c in text.strip())[:80] or f"body {number}"
        )
        seen[shown] = seen.get(shown, 0) + 1
        if seen[shown] > 1:
            shown = f"{shown} ({seen[shown]})"
        pieces.append(Piece(shown, first, end))
    return tuple(pieces)
