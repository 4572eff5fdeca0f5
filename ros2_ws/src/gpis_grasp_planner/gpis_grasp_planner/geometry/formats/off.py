"""OFF of Geomview and its variants: colours, normals, texture; counts and lines in any form."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.formats.parsed_mesh import (
    Index,
    ParsedMesh,
    bad_index,
    check_face_count,
    truncated,
)
from gpis_grasp_planner.geometry.formats.polygons import triangulate
from gpis_grasp_planner.geometry.formats.recognise import refuse_bytes
from gpis_grasp_planner.geometry.formats.words import Words, level, without_comments

# The word may be glued to the first count ("OFF8 6 12"), as in a well-known collection.
_HEAD = re.compile(rb"\s*(?P<kind>(ST|C|N)*(?P<four>4)?(?P<n>n)?OFF)(\s*(?P<binary>BINARY))?")
_HEAD_ANY_CASE = re.compile(_HEAD.pattern.replace(b"(?P<n>n)?", b"(?P<n>\\b\\B)?"), re.IGNORECASE)


@dataclass(frozen=True)
class _Layout:
    """Where vertices and faces are: indices of words."""

    vertices: Index  # (v, 3) words of coordinates
    sizes: Index  # (f,) words with the number of corners
    passed_over: int = 0  # words after the last face


def read_off(data: bytes, name: str, max_faces: int) -> ParsedMesh:
    """Read an OFF file; its first word may be missing where the counts fit the rest."""
    text = without_comments(level(data))
    head = _HEAD.match(text) or _HEAD_ANY_CASE.match(text)
    if head is None:
        refuse_bytes(data, name, "OFF")
    elif head["four"] or head["n"] or head["binary"]:
        kind = (head["kind"] + b" " + (head["binary"] or b"")).decode().strip()
        raise MeshError(
            f"{name} is of the kind '{kind}', which is not read. Export plain OFF, or STL, OBJ or "
            "PLY.",
            ErrorCode.MESH_FORMAT_NOT_SUPPORTED,
        )
    end = head.end("kind") if head else 0
    words = Words(b" " * end + text[end:])
    variant = head["kind"].upper() if head else b"OFF"
    layout, n_vertices = _found(words, variant, head is not None, name, max_faces)
    vertices = words.picked(layout.vertices.reshape(-1), name, "a coordinate").reshape(-1, 3)
    corners, counts = _polygons(words, layout, n_vertices, name)
    check_face_count(int(counts.sum()) - 2 * len(counts), name, max_faces)
    faces, _, skewed = triangulate(vertices, corners, counts, name)
    doubt = None
    if not data.endswith((b"\n", b"\r")):
        doubt = "it ends without a newline, perhaps within its last number"
    notes: tuple[str, ...] = ()
    if layout.passed_over:
        doubt = "words follow the faces that it counts"
        notes = (f"{layout.passed_over} words after the last face were ignored.",)
    return ParsedMesh(vertices, faces, notes=(*notes, *skewed), doubt=doubt)


def _integers(words: Words, chosen: Index) -> Index | None:
    return words.picked_integers(chosen, words.ends[chosen])


def _found(
    words: Words, variant: bytes, has_head: bool, name: str, max_faces: int
) -> tuple[_Layout, int]:
    """The layout and the number of vertices.

    The third count, of edges, is missing in some files: where just two stand on their line, and
    what follows fits them.
    """
    if len(words) < 2:
        raise truncated(name, "the counts of vertices and faces are missing")
    on_line = int((words.lines == words.lines[0]).sum())
    error = None
    for taken in (2, 3) if on_line == 2 else (3,):
        n_vertices, n_faces = _counts(words, taken, on_line, has_head, name)
        check_face_count(n_faces, name, max_faces)
        try:
            return _layout(words, variant, n_vertices, n_faces, taken, name), n_vertices
        except MeshError as failed:
            error = error or failed
    assert error is not None
    raise error


def _counts(words: Words, taken: int, on_line: int, has_head: bool, name: str) -> tuple[int, int]:
    counts = _integers(words, np.arange(min(taken, len(words))))
    if counts is None or (counts < 0).any() or len(counts) < taken:
        what = "does not start with 'OFF'" if not has_head else "is damaged"
        shown = " ".join(words.word(i)[:20].decode("ascii", "replace") for i in range(on_line)[:4])
        raise MeshError(
            f"{name} {what}: its counts of vertices, faces and edges are '{shown[:60]}', they must "
            "be integers. Export it again."
        )
    return int(counts[0]), int(counts[1])


def _layout(
    words: Words, variant: bytes, n_vertices: int, n_faces: int, first: int, name: str
) -> _Layout:
    """One vertex and one face a line, as all write them, or else a stream of words."""
    lines = words.firsts
    lines = lines[lines >= first]
    lengths = np.diff(np.append(lines, len(words)))
    if len(lines) == n_vertices + n_faces and (lengths[:n_vertices] >= 3).all():
        sizes = _integers(words, lines[n_vertices:])
        if sizes is not None and (sizes < lengths[n_vertices:]).all():
            return _Layout(lines[:n_vertices, None] + np.arange(3), lines[n_vertices:])
    step = 3 + 3 * (b"N" in variant) + 4 * (b"C" in variant) + 2 * (b"ST" in variant)
    at = first + step * n_vertices
    sizes_at = _stream(words, at, n_faces)
    if sizes_at is None:
        found = _lines_before_others(words, lines, lengths, n_vertices, n_faces)
        if found is not None:
            return found
        raise truncated(
            name,
            f"its head promises {n_vertices} vertices and {n_faces} faces, {len(lines)} lines with "
            f"{len(words) - first} numbers follow",
        )
    return _Layout(first + step * np.arange(n_vertices)[:, None] + np.arange(3), sizes_at)


def _lines_before_others(
    words: Words, lines: Index, lengths: Index, n_vertices: int, n_faces: int
) -> _Layout | None:
    """One vertex and one face a line, and then what the counts do not speak of."""
    end = n_vertices + n_faces
    if len(lines) <= end or (lengths[:n_vertices] != lengths[0]).any() or lengths[0] < 3:
        return None
    sizes = _integers(words, lines[n_vertices:end])
    if sizes is None or (sizes >= lengths[n_vertices:end]).any() or (sizes < 3).any():
        return None
    heads = lines[:n_vertices, None] + np.arange(3)
    return _Layout(heads, lines[n_vertices:end], len(words) - int(lines[end]))


def _stream(words: Words, at: int, n_faces: int) -> Index | None:
    """The words that say the sizes of faces, if faces without colours fill the rest exactly."""
    rest = _integers(words, np.arange(at, len(words))) if at < len(words) else None
    if rest is None:
        return None
    sizes = np.empty(n_faces, dtype=np.int64)
    values = rest.tolist()
    position = 0
    for i in range(n_faces):
        if position >= len(values) or values[position] < 0:
            return None
        sizes[i] = at + position
        position += 1 + values[position]
    return sizes if position == len(values) else None


def _polygons(words: Words, layout: _Layout, n_vertices: int, name: str) -> tuple[Index, Index]:
    counts = _integers(words, layout.sizes)
    few = np.flatnonzero(counts < 3) if counts is not None else np.zeros(1, dtype=np.int64)
    if counts is None or few.size:
        line = words.line(int(layout.sizes[few[0]]))
        shown = words.word(int(layout.sizes[few[0]]))[:20].decode("ascii", "replace")
        raise truncated(name, f"face {few[0] + 1} (line {line}) has {shown} corners, it takes 3")
    of = np.repeat(np.arange(len(counts)), counts)
    rank = np.arange(len(of)) - np.repeat(np.cumsum(counts) - counts, counts)
    chosen = layout.sizes[of] + 1 + rank
    corners = _integers(words, chosen)
    if corners is None:
        raise truncated(name, "a face holds something else than whole numbers")
    wrong = np.flatnonzero((corners < 0) | (corners >= n_vertices))
    if wrong.size:
        raise bad_index(name, int(of[wrong[0]]) + 1, int(corners[wrong[0]]), n_vertices)
    return corners, counts
