"""Arrays by name in one file's bytes, with a checksum; read without copies."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

_MAGIC = b"gpis-grasp arrays 1\n"
_CHECKSUM = 32
_ALIGNMENT = 64
_START = len(_MAGIC) + _CHECKSUM


def pack(arrays: Mapping[str, Any]) -> bytes:
    """Bytes of arrays, numbers and truth values by name.

    Raises
    ------
    TypeError
        For arrays of objects.
    """
    table, blocks, offset = [], [], 0
    for name, value in arrays.items():
        array = np.asarray(value, order="C")
        if array.dtype.hasobject:
            raise TypeError(f"{name} holds Python objects; only numbers can be packed.")
        table.append([name, array.dtype.str, list(array.shape), offset])
        padding = -array.nbytes % _ALIGNMENT
        blocks += [array.tobytes(), bytes(padding)]
        offset += array.nbytes + padding
    head = json.dumps(table).encode()
    head = len(head).to_bytes(8, "little") + head
    body = head + bytes(-(_START + len(head)) % _ALIGNMENT) + b"".join(blocks)
    return _MAGIC + hashlib.sha256(body).digest() + body


def unpack(content: bytes | bytearray) -> dict[str, NDArray[Any]]:
    """Arrays of :func:`pack`'s bytes; they share the memory of `content`, well aligned.

    Of a ``bytearray`` they can be written to, as fresh ones can.

    Raises
    ------
    ValueError
        For bytes that are not as they were written.
    """
    view = memoryview(content)
    if bytes(view[: len(_MAGIC)]) != _MAGIC:
        raise ValueError("no packed arrays")
    if hashlib.sha256(view[_START:]).digest() != bytes(view[len(_MAGIC) : _START]):
        raise ValueError("the checksum is another one")
    length = int.from_bytes(view[_START : _START + 8], "little")
    table = json.loads(bytes(view[_START + 8 : _START + 8 + length]))
    start = _START + 8 + length
    start += -start % _ALIGNMENT
    arrays = {}
    for name, dtype, shape, offset in table:
        count = int(np.prod(shape, dtype=np.int64))
        array = np.frombuffer(content, np.dtype(dtype), count, start + offset)
        arrays[name] = array.reshape(shape)
    return arrays
