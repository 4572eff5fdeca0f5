"""PCD, ASCII, binary and compressed: fields of a header, points, and where the sensor stood."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import MeshError
from gpis_grasp_planner.geometry.formats.parsed_cloud import (
    ParsedCloud,
    check_point_count,
    own_normals,
)
from gpis_grasp_planner.geometry.formats.parsed_mesh import truncated
from gpis_grasp_planner.geometry.formats.recognise import refuse_foreign

Array = NDArray[np.float64]

_TYPES = {"F4": "f4", "F8": "f8", "I1": "i1", "I2": "i2", "I4": "i4", "I8": "i8",
          "U1": "u1", "U2": "u2", "U4": "u4", "U8": "u8"}  # fmt: skip
_MOST_HEADER_BYTES = 10_000
_XYZ = ("x", "y", "z")
_NORMALS = ("normal_x", "normal_y", "normal_z")


def read_pcd(data: bytes, name: str, most: int) -> ParsedCloud:
    """Read a PCD file (version 0.5 to 0.7).

    Rows that are not finite are how an organised cloud says that nothing was measured; they are
    left out with a note. The viewpoint of the header counts unless it is the default 0 0 0.
    """
    header, start = _header(data, name)
    names = header.get("FIELDS", [])
    missing = [axis for axis in _XYZ if axis not in names]
    if missing:
        raise MeshError(f"{name} has no field '{missing[0]}'. Export points with x, y and z.")
    columns = _columns(header, name)
    count = _count(header, name)
    check_point_count(count, name, most)
    encoding = header.get("DATA", [""])[0].lower()
    if encoding == "ascii":
        table = _ascii(data[start:], columns, count, name)
    elif encoding == "binary":
        table = _binary(data[start:], columns, count, name)
    elif encoding == "binary_compressed":
        table = _compressed(data[start:], columns, count, name)
    else:
        raise MeshError(
            f"{name} has data that are '{encoding[:40]}'; ascii, binary and binary_compressed are "
            "read. Save it again as one of these."
        )
    points = np.stack([table[axis] for axis in _XYZ], axis=1)
    finite = np.isfinite(points).all(axis=1)
    notes: tuple[str, ...] = ()
    if not finite.all():
        notes = (f"{int((~finite).sum())} of {count} rows hold no point (NaN) and were left out.",)
        check_point_count(int(finite.sum()), name, most)
    normals = None
    if all(n in table for n in _NORMALS):
        normals = own_normals(np.stack([table[n] for n in _NORMALS], axis=1)[finite])
    return ParsedCloud(points[finite], normals, _viewpoint(header, name), notes)


def _header(data: bytes, name: str) -> tuple[dict[str, list[str]], int]:
    """Words after each key, and where the data start."""
    head = data[:_MOST_HEADER_BYTES]
    header: dict[str, list[str]] = {}
    at = 0
    while True:
        end = head.find(b"\n", at)
        if end < 0:
            refuse_foreign(data, name, "PCD")
            raise truncated(name, "its header has no line 'DATA'")
        words = head[at:end].decode("ascii", "replace").split()
        at = end + 1
        if words and not words[0].startswith("#"):
            header[words[0].upper()] = words[1:]
        if words and words[0].upper() == "DATA":
            return header, at


def _columns(header: dict[str, list[str]], name: str) -> list[tuple[str, str, int]]:
    """Name, numpy type and count of each field."""
    names = header["FIELDS"]
    sizes, kinds = header.get("SIZE", []), header.get("TYPE", [])
    counts = header.get("COUNT", ["1"] * len(names))
    if not len(names) == len(sizes) == len(kinds) == len(counts):
        raise truncated(
            name,
            f"it has {len(names)} fields, {len(sizes)} sizes, {len(kinds)} types and "
            f"{len(counts)} counts",
        )
    columns = []
    for field, size, kind, n in zip(names, sizes, kinds, counts, strict=True):
        dtype = _TYPES.get(kind.upper() + size)
        if dtype is None or not n.isdecimal() or not 0 < int(n) <= 1000:
            raise MeshError(
                f"{name}: field '{field[:40]}' has type {kind[:10]!r}, size {size[:10]!r} and "
                f"count {n[:10]!r}, which is no PCD. Export it again."
            )
        columns.append((field, dtype, int(n)))
    return columns


def _count(header: dict[str, list[str]], name: str) -> int:
    try:
        if "POINTS" in header:
            return int(header["POINTS"][0])
        return int(header["WIDTH"][0]) * int(header["HEIGHT"][0])
    except (KeyError, IndexError, ValueError):
        raise truncated(name, "its header does not say how many points there are") from None


def _ascii(
    text: bytes, columns: list[tuple[str, str, int]], count: int, name: str
) -> dict[str, Array]:
    width = sum(n for _, _, n in columns)
    words = text.split()
    if len(words) < count * width:
        raise truncated(name, f"it declares {count} points and holds {len(words) // width}")
    try:
        rows = np.array(words[: count * width], dtype="S32").astype(np.float64)
    except ValueError:
        raise MeshError(f"{name} has a word among its points that is no number.") from None
    rows = rows.reshape(count, width)
    at = np.cumsum([0, *(n for _, _, n in columns)])
    return {field: rows[:, at[k]] for k, (field, _, _) in enumerate(columns)}


def _binary(
    data: bytes, columns: list[tuple[str, str, int]], count: int, name: str
) -> dict[str, Array]:
    row = np.dtype([(f"{k}", f"<{kind}", (n,)) for k, (_, kind, n) in enumerate(columns)])
    if count * row.itemsize > len(data):
        raise truncated(name, f"it declares {count} points and holds {len(data) // row.itemsize}")
    rows = np.frombuffer(data, row, count)
    return {field: rows[f"{k}"][:, 0].astype(np.float64) for k, (field, _, _) in enumerate(columns)}


def _compressed(
    data: bytes, columns: list[tuple[str, str, int]], count: int, name: str
) -> dict[str, Array]:
    """Two sizes, and in LZF the values of all points field by field; fields '_' are left out."""
    from gpis_grasp_planner.geometry.formats.lzf import unpacked  # numba, which the node saves

    columns = [c for c in columns if c[0] != "_"]
    expected = count * sum(n * np.dtype(kind).itemsize for _, kind, n in columns)
    packed = int.from_bytes(data[:4], "little")
    size = int.from_bytes(data[4:8], "little")
    if len(data) < 8 or 8 + packed > len(data):
        raise truncated(name, f"it declares {packed} compressed bytes and holds {len(data) - 8}")
    if size != expected:
        raise truncated(
            name, f"its {count} points take {expected} bytes, and {size} are said to be compressed"
        )
    content = unpacked(data[8 : 8 + packed], size)
    if content is None:
        raise truncated(name, "its compressed data are damaged")
    table: dict[str, Array] = {}
    at = 0
    for field, kind, n in columns:
        values = np.frombuffer(content, f"<{kind}", count * n, at)
        table[field] = values.reshape(count, n)[:, 0].astype(np.float64)
        at += values.nbytes
    return table


def _viewpoint(header: dict[str, list[str]], name: str) -> Array:
    words = header.get("VIEWPOINT", [])
    try:
        position = np.array(words[:3], dtype=np.float64)
    except ValueError:
        position = np.full(3, np.nan)
    if not words or not position.any():
        return np.zeros((0, 3))
    if len(position) != 3 or not np.isfinite(position).all():
        raise MeshError(f"{name}: its VIEWPOINT is {' '.join(words)[:60]!r}; it takes 7 numbers.")
    return position[None]
