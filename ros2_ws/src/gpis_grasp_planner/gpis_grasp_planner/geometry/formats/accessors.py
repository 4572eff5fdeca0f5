"""Accessors of glTF: typed views of the file's one buffer, and never of anything else."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


class AccessorError(Exception):
    """What is wrong with an accessor, as a part of a sentence."""


class Accessors:
    """Reads the accessors of a glTF document; `binary` is the file's own chunk."""

    def __init__(self, document: dict[str, Any], binary: bytes):
        self._accessors = document.get("accessors", [])
        self._views = document.get("bufferViews", [])
        self._buffers = document.get("buffers", [])
        self._binary = binary
        self._unpacked: dict[int, bytes] = {}
        self._points: dict[int, Array] = {}

    def positions(self, index: int) -> Array:
        """Points (n, 3) of an accessor of VEC3; primitives that share it share the array."""
        if index not in self._points:
            self._points[index] = self._read_points(index)
        return self._points[index]

    def _read_points(self, index: int) -> Array:
        accessor = self._accessor(index)
        values = self._values(accessor, 3).astype(np.float64)
        if accessor.get("normalized") and accessor["componentType"] != 5126:
            highest = np.iinfo(np.dtype(_COMPONENTS[accessor["componentType"]])).max
            values = np.maximum(values / highest, -1.0)
        return values

    def indices(self, index: int) -> Index:
        """Indices (n,) of an accessor of SCALAR."""
        accessor = self._accessor(index)
        if accessor.get("componentType") == 5126:
            raise AccessorError("its indices are no integers")
        return self._values(accessor, 1).reshape(-1).astype(np.int64)

    def _accessor(self, index: int) -> dict[str, Any]:
        if not 0 <= index < len(self._accessors):
            raise AccessorError(f"accessor {index} is missing")
        accessor: dict[str, Any] = self._accessors[index]
        return accessor

    def _values(self, accessor: dict[str, Any], width: int) -> NDArray[Any]:
        kind = np.dtype(_COMPONENTS[accessor["componentType"]])
        if _WIDTHS.get(accessor["type"]) != width:
            raise AccessorError(f"an accessor is of type {str(accessor['type'])[:10]!r}")
        count = int(accessor["count"])
        if "bufferView" in accessor:
            values = self._strided(
                int(accessor["bufferView"]), int(accessor.get("byteOffset", 0)), kind, count, width
            )
        elif "sparse" not in accessor and count:
            raise AccessorError(f"an accessor of {count} entries has no data, as of compression")
        elif count <= sum(len(self._bytes(i)) for i in range(len(self._buffers))):
            values = np.zeros((count, width), dtype=kind)  # for a sparse accessor to fill
        else:
            raise AccessorError(f"an accessor of {count} entries has no data")
        sparse = accessor.get("sparse")
        if sparse is None:
            return values
        n = int(sparse["count"])
        where, what = sparse["indices"], sparse["values"]
        at = self._strided(
            int(where["bufferView"]),
            int(where.get("byteOffset", 0)),
            np.dtype(_COMPONENTS[where["componentType"]]),
            n,
            1,
        ).reshape(-1)
        values = values.copy()
        values[at] = self._strided(
            int(what["bufferView"]), int(what.get("byteOffset", 0)), kind, n, width
        )
        return values

    def _strided(
        self, view: int, offset: int, kind: np.dtype[Any], count: int, width: int
    ) -> NDArray[Any]:
        if view < 0 or count < 0 or offset < 0:
            raise AccessorError("an offset or a count is negative")
        description = self._views[view]
        start = int(description.get("byteOffset", 0))
        length = int(description["byteLength"])
        data = self._bytes(int(description.get("buffer", 0)))
        row = kind.itemsize * width
        stride = int(description.get("byteStride", 0)) or row
        if start < 0 or stride < row or start + length > len(data):
            raise AccessorError(f"a view of {length} bytes does not fit into {len(data)}")
        if count and offset + stride * (count - 1) + row > length:
            raise AccessorError(f"{count} entries do not fit into a view of {length} bytes")
        raw = np.frombuffer(data, np.uint8)[start + offset : start + length]
        rows = np.lib.stride_tricks.as_strided(raw, (count, row), (stride, 1))
        return np.ascontiguousarray(rows).view(kind).reshape(count, width)

    def _bytes(self, buffer: int) -> bytes:
        if not 0 <= buffer < len(self._buffers):
            raise AccessorError(f"buffer {buffer} is missing")
        uri = self._buffers[buffer].get("uri")
        if uri is None and buffer == 0:
            return self._binary
        if uri is None:
            raise AccessorError(f"buffer {buffer} has no data (a stand-in for compressed data?)")
        if not str(uri).startswith("data:"):
            raise AccessorError("its data lies in another file, which is not opened")
        if buffer not in self._unpacked:
            try:
                self._unpacked[buffer] = base64.b64decode(str(uri).partition(",")[2], validate=True)
            except ValueError:
                raise AccessorError("its embedded data is not valid base64") from None
        return self._unpacked[buffer]
