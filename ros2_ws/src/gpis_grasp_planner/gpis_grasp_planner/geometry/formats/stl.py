"""STL: binary by its length, ASCII by its words, in blocks of some megabytes."""

from __future__ import annotations

import re

import numpy as np

from gpis_grasp_planner.errors import MeshError
from gpis_grasp_planner.geometry.formats.parsed_mesh import (
    Array,
    ParsedMesh,
    check_face_count,
    named_pieces,
    truncated,
)
from gpis_grasp_planner.geometry.formats.recognise import is_text, refuse_foreign
from gpis_grasp_planner.geometry.formats.words import Words, level

HEADER_BYTES = 84
FACE_BYTES = 50
_BLOCK = 8_000_000

# Keywords become single bytes that no number holds; those that contain others come first.
_KEYWORDS = (b"endfacet", b"facet", b"normal", b"endloop", b"outer", b"loop", b"vertex")
_ENDFACET, _FACET, _NORMAL, _ENDLOOP, _OUTER, _LOOP, _VERTEX = range(1, 8)
_PATTERN = np.array(
    [_FACET, _OUTER, _LOOP, *(3 * [_VERTEX, 0, 0, 0]), _ENDLOOP, _ENDFACET], dtype=np.uint8
)
_NUMBERS = np.flatnonzero(_PATTERN == 0)
# A name may hold any word; on one line with a facet it ends where the facet starts.
_NAME = rb"solid\b(?P<name>(?:(?!\bfacet\s+normal\s+[-+.\d]).)*)"
_SOLID = re.compile(rb"^[ \t]*(?P<end>\b\B)?" + _NAME, re.MULTILINE)
_END = re.compile(rb"\b(?P<end>end)[ \t]*" + _NAME)


def read_stl(data: bytes, name: str, max_faces: int) -> ParsedMesh:
    """Read an STL file; what is not STL at all is told apart.

    A binary file is one whose length is that of its count, whatever its header says. A count
    of 0 before whole facets is what some exporters write: the length counts.
    """
    if _binary_length(data) == len(data):
        return _read_binary(data, name, max_faces)
    if (parts := _binary_parts(data)) and len(parts) > 1:
        return _joined([_read_binary(p, name, max_faces) for p in parts], name, max_faces)
    head = level(data[:4096]).lower()
    looks_ascii = is_text(data) or (b"facet" in head and b"outer" in head)
    if head.lstrip()[:5] == b"solid" and looks_ascii:
        return _read_ascii(data, name, max_faces)
    refuse_foreign(data, name, "STL")
    if is_text(data):
        raise MeshError(
            f"{name} is a text, but no ASCII STL: it does not start with 'solid'. Export it again."
        )
    return _read_binary(data, name, max_faces)


def _binary_length(data: bytes) -> int:
    if len(data) < HEADER_BYTES:
        return -1
    return HEADER_BYTES + FACE_BYTES * int.from_bytes(data[80:84], "little")


def _binary_parts(data: bytes) -> list[bytes]:
    """Binary files that were written one after the other; empty where they do not fill `data`."""
    parts: list[bytes] = []
    start = 0
    while start < len(data):
        length = _binary_length(data[start : start + HEADER_BYTES])
        if not HEADER_BYTES < length <= len(data) - start:
            return []
        parts.append(data[start : start + length])
        start += length
    return parts


def _joined(parts: list[ParsedMesh], name: str, max_faces: int) -> ParsedMesh:
    sizes = [len(p.faces) for p in parts]
    faces = sum(sizes)
    check_face_count(faces, name, max_faces)
    starts = np.cumsum([0, *sizes[:-1]])
    return ParsedMesh(
        np.concatenate([p.vertices for p in parts]),
        np.arange(3 * faces).reshape(-1, 3),
        notes=(f"It holds {len(parts)} binary STL files, one after the other; all are read.",),
        pieces=named_pieces([("", int(first)) for first in starts], faces),
    )


def _read_binary(data: bytes, name: str, max_faces: int) -> ParsedMesh:
    if len(data) < HEADER_BYTES:
        raise truncated(name, f"{len(data)} bytes, an STL header alone has {HEADER_BYTES}")
    count = int.from_bytes(data[80:84], "little")
    whole, rest = divmod(len(data) - HEADER_BYTES, FACE_BYTES)
    notes: list[str] = []
    doubt = None
    if count == 0 and whole > 0:
        count = whole
        notes.append(f"The header counts no faces; by its length the file has {whole}.")
        doubt = f"its header counts no faces, and {rest} bytes are left over" if rest else None
    elif count > whole:
        raise truncated(
            name,
            f"as a binary STL its header promises {count} faces "
            f"({HEADER_BYTES + FACE_BYTES * count} bytes), the file has {len(data)} bytes",
        )
    check_face_count(count, name, max_faces)
    extra = len(data) - HEADER_BYTES - FACE_BYTES * count
    if extra:
        notes.append(f"{extra} bytes after the last of {count} faces were ignored.")
        if rest == 0 and doubt is None:
            doubt = f"its header counts {count} faces, and by its length it has {whole}"
    facet = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets = np.frombuffer(data, facet, count, HEADER_BYTES)
    corners = facets["corners"].reshape(-1, 3).astype(np.float64)
    return ParsedMesh(corners, np.arange(3 * count).reshape(-1, 3), notes=tuple(notes), doubt=doubt)


def _read_ascii(data: bytes, name: str, max_faces: int) -> ParsedMesh:
    blocks: list[Array] = []
    names = _Names(name)
    faces = position = line = passed_over = 0
    while position < len(data):
        end = _block_end(data, position)
        original = level(data[position:end])
        text = names.blanked(original, faces)
        block, remarks = _facets(text, faces, line, name)
        blocks.append(block)
        passed_over += remarks
        faces += len(blocks[-1]) // 3
        if faces > max_faces:
            check_face_count(data.lower().count(b"endfacet"), name, max_faces)
        line += original.count(b"\n")
        position = end
    check_face_count(faces, name, max_faces)
    doubt = None
    notes = []
    if names.inside:
        doubt = "the end of its last solid ('endsolid') is missing"
        notes.append("The end of the last solid ('endsolid') is missing.")
    if passed_over:
        doubt = doubt or "words stand between its facets"
        notes.append(f"{passed_over} words between facets were ignored.")
    if names.passed_over:
        notes.append(f"{names.passed_over} bytes of text outside of any solid were ignored.")
    return ParsedMesh(
        np.concatenate(blocks),
        np.arange(3 * faces).reshape(-1, 3),
        notes=tuple(notes),
        doubt=doubt,
        pieces=named_pieces(names.solids, faces),
    )


def _block_end(data: bytes, start: int) -> int:
    """Where the block from `start` ends: behind a facet, or at the end of the file."""
    if start + _BLOCK >= len(data):
        return len(data)
    at = data[start : start + _BLOCK].lower().rfind(b"endfacet")
    # A block without the end of a facet is no STL: the whole rest is read, to say where.
    return len(data) if at < 0 else start + at + len(b"endfacet")


class _Names:
    """The lines that open and close solids, and what stands between solids.

    Attributes
    ----------
    inside : bool
        Whether a solid is open at the end of what was read.
    passed_over : int
        Bytes outside of solids that are no blanks.
    solids : list of (str, int)
        Names with the number of facets before them.
    """

    def __init__(self, file_name: str):
        self.inside = False
        self.passed_over = 0
        self.solids: list[tuple[str, int]] = []
        self._file_name = file_name

    def blanked(self, original: bytes, faces: int) -> bytes:
        """A levelled block in lower case, with blanks in place of names; `faces` are before it."""
        text = original.lower()
        if b"solid" not in text:
            if not self.inside:
                self._pass_over(text)
                return b""
            return text
        kept: list[bytes] = []
        facets = faces
        position = 0
        while True:
            pattern = _END if self.inside else _SOLID
            match = pattern.search(text, position)
            part = text[position : match.start() if match else len(text)]
            if self.inside:
                kept.append(part)
                facets += part.count(b"endfacet")
            else:
                self._pass_over(part)
                kept.append(_blank(part))
            if match is None:
                return b"".join(kept)
            if not self.inside:
                title = original[match.start("name") : match.end("name")]
                self.solids.append((title.decode("utf-8", "replace"), facets))
            kept.append(_blank(match[0]))
            self.inside = match["end"] is None
            position = match.end()

    def _pass_over(self, text: bytes) -> None:
        if b"vertex" in text:
            raise truncated(self._file_name, "it has facets outside of any solid")
        self.passed_over += len(b"".join(text.split()))


def _blank(text: bytes) -> bytes:
    return re.sub(rb"[^\n]", b" ", text)


def _facets(text: bytes, before: int, lines: int, name: str) -> tuple[Array, int]:
    """Corners (3 f, 3) of a text in lower case without names of solids; words between facets."""
    for code, keyword in enumerate(_KEYWORDS, start=1):
        text = text.replace(keyword, bytes([code]) + b" " * (len(keyword) - 1))
    words = Words(text, lines)
    kind = words.bytes[words.starts]
    kind = np.where(kind <= _VERTEX, kind, 0).astype(np.uint8)
    # Normals are not used, and may hold anything (NaN, too): words from 'facet' to 'outer'.
    facets = np.cumsum(kind == _FACET)
    head = facets > np.cumsum(kind == _OUTER)
    # Between facets, remarks and colours of some exporters.
    between = (facets == np.cumsum(kind == _ENDFACET)) & (kind == 0) & bool(facets[-1:].any())
    kept = np.flatnonzero((~head | (kind == _FACET)) & ~between)
    kind = kind[kept]
    count, rest = divmod(len(kind), len(_PATTERN))
    wrong = kind[: count * len(_PATTERN)].reshape(-1, len(_PATTERN)) != _PATTERN
    if rest or wrong.any():
        facet = int(np.flatnonzero(wrong.any(axis=1))[0]) if wrong.any() else count
        at = int(kept[min(facet * len(_PATTERN), len(kept) - 1)])
        raise truncated(
            name,
            f"facet {before + facet + 1} (line {words.line(at)}) is not 'facet', 'outer "
            "loop', three times 'vertex' with three numbers, 'endloop', 'endfacet'",
        )
    numbers = kept.reshape(-1, len(_PATTERN))[:, _NUMBERS].reshape(-1)
    values = words.picked(numbers, name, f"a vertex after facet {before}")
    return values.reshape(-1, 3), int(between.sum())
