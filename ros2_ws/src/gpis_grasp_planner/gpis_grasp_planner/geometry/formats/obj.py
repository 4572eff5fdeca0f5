"""Wavefront OBJ, in blocks of lines: vertices, polygons, objects; all else is passed over."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.formats.parsed_mesh import (
    Array,
    Index,
    ParsedMesh,
    check_face_count,
    named_pieces,
    truncated,
)
from gpis_grasp_planner.geometry.formats.polygons import triangulate
from gpis_grasp_planner.geometry.formats.recognise import refuse_bytes
from gpis_grasp_planner.geometry.formats.words import Words, level, without_comments

_BLOCK = 8_000_000
_KEY_BYTES = 8
_MOST_INDEX = 2**62
_VERTEX, _FACES, _OBJECT, _GROUP = b"v", (b"f", b"fo"), b"o", b"g"
_PASSED_OVER = (
    b"vt", b"vn", b"vp", b"l", b"p", b"s", b"mg", b"usemtl", b"mtllib", b"usemap", b"maplib",
    b"bevel", b"c_interp", b"d_interp", b"lod", b"shadow_o", b"trace_ob",
)  # fmt: skip
_CURVED = (b"curv", b"curv2", b"surf", b"cstype", b"deg", b"bmat", b"step", b"parm", b"trim",
           b"hole", b"scrv", b"sp", b"end", b"con", b"ctech", b"stech", b"bsp", b"bzp", b"cdc",
           b"cdp", b"res", b"call", b"csh")  # fmt: skip
_CONTINUED = re.compile(rb"\\[ \t]*(?:\n|\Z)")


def _key(word: bytes) -> int:
    return int.from_bytes(word[:_KEY_BYTES].ljust(_KEY_BYTES, b"\0"), "little")


_VERTEX_KEY, _OBJECT_KEY, _GROUP_KEY = _key(_VERTEX), _key(_OBJECT), _key(_GROUP)
_FACE_KEYS = np.array([_key(w) for w in _FACES], dtype=np.uint64)
_KNOWN_KEYS = np.array(
    sorted({_key(w) for w in (_VERTEX, *_FACES, _OBJECT, _GROUP, *_PASSED_OVER)}), dtype=np.uint64
)


class _Content:
    """What was read so far."""

    def __init__(self) -> None:
        self.vertices: list[Array] = []
        self.corners: list[Index] = []
        self.counts: list[Index] = []
        self.lines: list[Index] = []  # of each polygon
        self.n_vertices = 0
        self.n_polygons = 0
        self.line = 0
        self.objects: list[tuple[str, int]] = []
        self.groups: list[tuple[str, int]] = []
        self.unknown: dict[str, int] = {}  # statement and its first line


def read_obj(data: bytes, name: str, max_faces: int) -> ParsedMesh:
    """Read an OBJ file; indices may be relative, also between blocks of vertices."""
    refuse_bytes(data, name, "OBJ")
    content = _Content()
    for block in _blocks(data):
        _read_block(block, content, name)
        if sum(int(c.sum()) - 2 * len(c) for c in content.counts) > max_faces:
            break
    corners, counts = _joined(content.corners), _joined(content.counts)
    triangles = int(counts.sum()) - 2 * len(counts)
    curved = [w for w in content.unknown if w.encode() in _CURVED]
    if triangles == 0 and curved:
        raise MeshError(
            f"{name} holds curved surfaces ('{curved[0]}', line {content.unknown[curved[0]]}) and "
            "no faces. Export it as a mesh of polygons.",
            ErrorCode.MESH_EMPTY,
        )
    if triangles == 0 and content.unknown:
        word, line = next(iter(content.unknown.items()))
        raise MeshError(
            f"{name} has no faces; its line {line} starts with {word!r}, which is no statement of "
            "OBJ. Export it again, as a mesh.",
            ErrorCode.MESH_EMPTY,
        )
    check_face_count(triangles, name, max_faces)
    _check_indices(corners, counts, content, name)
    vertices = np.concatenate(content.vertices)
    faces, first, skewed = triangulate(vertices, corners, counts, name)
    names = content.objects or content.groups
    doubt, notes = None, []
    if content.unknown:
        word, line = next(iter(content.unknown.items()))
        doubt = f"it has statements that OBJ does not know ('{word}', line {line})"
        notes.append(
            f"Statements that are not read: {', '.join(sorted(content.unknown)[:5])} (first in "
            f"line {line})."
        )
    if not data.endswith((b"\n", b"\r")):
        doubt = doubt or "it ends without a newline, perhaps within its last number"
    return ParsedMesh(
        vertices,
        faces,
        notes=(*notes, *skewed),
        doubt=doubt,
        pieces=named_pieces([(n, int(first[p])) for n, p in names], len(faces)),
    )


def _joined(parts: list[Index]) -> Index:
    return np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)


def _blocks(data: bytes) -> Iterator[bytes]:
    """Levelled blocks of whole lines, continued lines joined, without comments."""
    newline = b"\n" if b"\n" in data else b"\r"
    position = 0
    while position < len(data):
        end = len(data)
        if position + _BLOCK < end:
            at = data.rfind(newline, position, position + _BLOCK)
            while at > position and data[position:at].rstrip().endswith(b"\\"):
                at = data.rfind(newline, position, at)
            end = at + 1 if at > position else end
        # A comment ends with its line, also where that ends with a backslash (a Windows path).
        text = without_comments(level(data[position:end]))
        if b"\\" in text:
            text = _CONTINUED.sub(lambda m: b" " * len(m[0]), text)
        yield text
        position = end


def _read_block(text: bytes, content: _Content, name: str) -> None:
    words = Words(text, content.line)
    heads = words.firsts
    lengths = np.diff(np.append(heads, len(words))) - 1  # words after the statement's own
    keys = _keys(words, heads)
    is_vertex = keys == _VERTEX_KEY
    is_face = np.isin(keys, _FACE_KEYS)
    _read_vertices(words, heads[is_vertex], lengths[is_vertex], content, name)
    before = content.n_vertices + np.cumsum(is_vertex)[is_face]
    polygons_before = content.n_polygons
    _read_faces(words, heads[is_face], lengths[is_face], before, content, name)
    for key, names in ((_OBJECT_KEY, content.objects), (_GROUP_KEY, content.groups)):
        rows = np.flatnonzero(keys == key)
        for row, polygon in zip(rows, polygons_before + np.cumsum(is_face)[rows], strict=True):
            parts = [words.word(heads[row] + 1 + i) for i in range(int(lengths[row]))]
            names.append((b" ".join(parts).decode("utf-8", "replace"), int(polygon)))
    for row in np.flatnonzero(~np.isin(keys, _KNOWN_KEYS)):
        word = words.word(heads[row])[:20].decode("ascii", "replace")
        if word not in content.unknown and len(content.unknown) < 100:
            content.unknown[word] = words.line(heads[row])
    content.n_vertices += int(is_vertex.sum())
    content.line += text.count(b"\n")


def _keys(words: Words, heads: Index) -> Index:
    """The first eight bytes of the words `heads`, as one number each."""
    padded = np.concatenate([words.bytes, np.zeros(_KEY_BYTES, dtype=np.uint8)])
    letters = padded[words.starts[heads][:, None] + np.arange(_KEY_BYTES)]
    letters[np.arange(_KEY_BYTES) >= (words.ends[heads] - words.starts[heads])[:, None]] = 0
    return letters.view("<u8").reshape(-1)


def _read_vertices(
    words: Words, heads: Index, lengths: Index, content: _Content, name: str
) -> None:
    short = np.flatnonzero(lengths < 3)
    if short.size:
        raise truncated(
            name,
            f"vertex {content.n_vertices + short[0] + 1} (line {words.line(heads[short[0]])}) "
            "has no 3 numbers",
        )
    chosen = (heads[:, None] + np.arange(1, 4)).reshape(-1)
    where = f"a coordinate of a vertex after vertex {content.n_vertices}"
    content.vertices.append(words.picked(chosen, name, where).reshape(-1, 3))


def _read_faces(
    words: Words, heads: Index, lengths: Index, before: Index, content: _Content, name: str
) -> None:
    short = np.flatnonzero(lengths < 3)
    if short.size:
        raise truncated(
            name,
            f"face {content.n_polygons + short[0] + 1} (line {words.line(heads[short[0]])}) has "
            f"{lengths[short[0]]} corners, it takes 3",
        )
    if len(heads) == 0:
        return
    of = np.repeat(np.arange(len(heads)), lengths)
    rank = np.arange(len(of)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    chosen = heads[of] + 1 + rank
    slashes = np.append(np.flatnonzero(words.bytes == ord("/")), len(words.bytes))
    cut = slashes[np.searchsorted(slashes, words.starts[chosen])]
    indices = words.picked_integers(chosen, np.minimum(words.ends[chosen], cut))
    lines = content.line + 1 + words.lines[heads]
    if indices is None:
        raise _no_integer(words, chosen, of, lines, content, name)
    wrong = np.flatnonzero((indices == 0) | (indices < -before[of]) | (indices > _MOST_INDEX))
    if wrong.size:
        face = of[wrong[0]]
        shown = words.word(chosen[wrong[0]])[:40].split(b"/")[0].decode("ascii", "replace")
        raise MeshError(
            f"{name}: face {content.n_polygons + face + 1} (line {lines[face]}) uses vertex index "
            f"{shown}; OBJ indices start at 1, or at -1 counting back over the "
            f"{before[face]} vertices so far. Export it again.",
            ErrorCode.MESH_BAD_INDEX,
        )
    content.corners.append(np.where(indices < 0, before[of] + indices, indices - 1))
    content.counts.append(lengths)
    content.lines.append(lines)
    content.n_polygons += len(heads)


def _no_integer(
    words: Words, chosen: Index, of: Index, lines: Index, content: _Content, name: str
) -> MeshError:
    for word, face in zip(chosen, of, strict=True):
        index = words.word(word).split(b"/")[0]
        if re.fullmatch(rb"[+-]?\d+", index) is None:
            shown = words.word(word)[:20].decode("ascii", "replace")
            return MeshError(
                f"{name}: face {content.n_polygons + face + 1} (line {lines[face]}) has the corner "
                f"{shown!r}; it must start with an integer. Export it again."
            )
    return MeshError(f"{name}: its faces cannot be read. Export it again.")


def _check_indices(corners: Index, counts: Index, content: _Content, name: str) -> None:
    wrong = np.flatnonzero(corners >= content.n_vertices)
    if wrong.size == 0:
        return
    face = int(np.searchsorted(np.cumsum(counts), wrong[0], side="right"))
    index = int(corners[wrong].max()) + 1
    raise MeshError(
        f"{name}: face {face + 1} (line {_joined(content.lines)[face]}) uses vertex index {index}, "
        f"the file has {content.n_vertices} vertices. It may be truncated; export it again.",
        ErrorCode.MESH_BAD_INDEX,
    )
