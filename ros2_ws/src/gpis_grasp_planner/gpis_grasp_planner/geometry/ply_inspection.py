"""Inspection of PLY files: what follows the header must have the size the header declares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.inspection_checks import (
    Inspection,
    bad_index,
    check_face_count,
    check_finite,
    check_polygon,
    to_integer,
    truncated,
)

PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: tuple[tuple[str, ...], ...]


def inspect_ply(data: bytes, name: str, max_faces: int) -> Inspection:
    """Compare the elements a PLY header declares with the bytes or lines that follow it."""
    encoding, elements, body = _ply_header(data, name)
    counts = {e.name: e.count for e in elements}
    if "vertex" not in counts or "face" not in counts:
        raise MeshError(
            f"{name} declares no {'faces' if 'vertex' in counts else 'vertices'}; a point cloud "
            "is not a mesh. Export triangles.",
            ErrorCode.MESH_EMPTY,
        )
    check_face_count(counts["face"], name, max_faces)
    if encoding == "ascii":
        return _inspect_ascii_ply(body, elements, name)
    order = "<" if encoding == "binary_little_endian" else ">"
    return _inspect_binary_ply(body, elements, order, name)


def _ply_header(data: bytes, name: str) -> tuple[str, list[_Element], bytes]:
    if data[:3] != b"ply":
        raise MeshError(f"{name} does not start with 'ply': not a PLY file, or a damaged one.")
    end = data.find(b"end_header")
    newline = data.find(b"\n", end)
    if end < 0 or newline < 0:
        raise truncated(name, "its header has no 'end_header'")
    encoding = ""
    elements: list[_Element] = []
    for line in data[:end].decode("ascii", "replace").splitlines():
        words = line.split()
        if words[:1] == ["format"] and len(words) > 1:
            encoding = words[1]
        elif words[:1] == ["element"] and len(words) == 3:
            count = to_integer(words[2].encode(), name, f"the count of element {words[1]}")
            if count < 0:
                raise MeshError(f"{name} declares {count} of element {words[1]}. Export it again.")
            elements.append(_Element(words[1], count, ()))
        elif words[:1] == ["property"] and len(words) >= 3 and elements:
            types = words[2:4] if words[1] == "list" else words[1:2]
            if any(t not in PLY_TYPES for t in types) or len(words) < 2 + len(types):
                raise MeshError(f"{name} has a property of unknown type: '{line[:60]}'.")
            e = elements[-1]
            elements[-1] = _Element(e.name, e.count, (*e.properties, tuple(words[1:])))
    if encoding not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise MeshError(f"{name} has the unknown PLY format '{encoding[:40]}'.")
    return encoding, elements, data[newline + 1 :]


def _inspect_ascii_ply(body: bytes, elements: list[_Element], name: str) -> Inspection:
    lines = [s for s in (line.split() for line in body.splitlines()) if s]
    promised = sum(e.count for e in elements)
    if len(lines) != promised:
        raise truncated(name, f"its header promises {promised} lines, {len(lines)} follow")
    vertices = next(e.count for e in elements if e.name == "vertex")
    triangles = start = 0
    for e in elements:
        rows = lines[start : start + e.count]
        start += e.count
        if e.name == "vertex":
            for i, row in enumerate(rows, start=1):
                if len(row) != len(e.properties):
                    raise truncated(
                        name, f"vertex {i} has {len(row)} of {len(e.properties)} numbers"
                    )
                check_finite(row, name, f"vertex {i}")
        elif e.name == "face":
            for i, row in enumerate(rows, start=1):
                triangles += check_polygon(row, i, vertices, name)
    return Inspection(triangles, body.endswith((b"\n", b"\r")))


def _inspect_binary_ply(body: bytes, elements: list[_Element], order: str, name: str) -> Inspection:
    position = triangles = 0
    vertices = next(e.count for e in elements if e.name == "vertex")
    for e in elements:
        if not any(p[0] == "list" for p in e.properties):
            position += e.count * sum(np.dtype(PLY_TYPES[p[0]]).itemsize for p in e.properties)
            if position > len(body):
                raise _ply_short(name, e, len(body))
            continue
        for i in range(1, e.count + 1):
            for p in e.properties:
                if p[0] != "list":
                    position += np.dtype(PLY_TYPES[p[0]]).itemsize
                    continue
                values, position = _read_list(body, position, p, order)
                if values is None:
                    raise _ply_short(name, e, len(body))
                if e.name == "face" and p[-1] in ("vertex_indices", "vertex_index"):
                    triangles += _check_corners(values, i, vertices, name)
    if position != len(body):
        raise MeshError(
            f"{name}: its header describes {position} bytes of data, {len(body)} follow. "
            "Export or copy it again."
        )
    return Inspection(triangles)


def _read_list(
    body: bytes, position: int, types: tuple[str, ...], order: str
) -> tuple[NDArray[Any] | None, int]:
    """One list property and the position after it; None where the body is too short."""
    head, item = np.dtype(order + PLY_TYPES[types[1]]), np.dtype(order + PLY_TYPES[types[2]])
    start = position + head.itemsize
    if start > len(body):
        return None, position
    count = int(np.frombuffer(body, head, 1, position)[0])
    end = start + count * item.itemsize
    if count < 0 or end > len(body):
        return None, position
    return np.frombuffer(body, item, count, start), end


def _check_corners(indices: NDArray[Any], face: int, vertices: int, name: str) -> int:
    wide = indices.astype(np.int64)
    wrong = wide[(wide < 0) | (wide >= vertices)]
    if wrong.size:
        raise bad_index(name, face, int(wrong[0]), vertices)
    if len(wide) < 3:
        raise truncated(name, f"face {face} has {len(wide)} corners, it takes 3")
    return len(wide) - 2


def _ply_short(name: str, element: _Element, size: int) -> MeshError:
    detail = f"{size} bytes of data do not hold {element.count} of element {element.name}"
    return truncated(name, detail)
