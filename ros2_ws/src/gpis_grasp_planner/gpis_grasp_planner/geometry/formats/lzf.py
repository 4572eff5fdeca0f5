"""LZF, the compression of PCD files: literal runs, and copies of what came before."""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.compiled import njit

MOST_RATIO = 100  # three bytes give at most 264


def unpacked(data: bytes, size: int) -> bytes | None:
    """The `size` bytes that LZF data hold; None where they hold something else.

    Parameters
    ----------
    data : bytes
    size : int
        At most :data:`MOST_RATIO` times the length of `data`; more cannot be in it.
    """
    if size > MOST_RATIO * len(data):
        return None
    out = np.empty(size, dtype=np.uint8)
    if _unpack(np.frombuffer(data, dtype=np.uint8), out) != size:
        return None
    return out.tobytes()


@njit
def _unpack(data, out):  # type: ignore[no-untyped-def]
    """Unpack into `out`; the number of bytes written, or -1 for data that are damaged."""
    n, size = len(data), len(out)
    i = np.int64(0)
    at = np.int64(0)
    while i < n:
        control = np.int64(data[i])
        i += 1
        if control < 32:
            length = control + 1
            if i + length > n or at + length > size:
                return -1
            for k in range(length):
                out[at + k] = data[i + k]
            i += length
        else:
            length = control >> 5
            if length == 7:
                if i >= n:
                    return -1
                length += np.int64(data[i])
                i += 1
            length += 2
            if i >= n:
                return -1
            start = at - ((control & 31) << 8) - np.int64(data[i]) - 1
            i += 1
            if start < 0 or at + length > size:
                return -1
            for k in range(length):
                out[at + k] = out[start + k]
        at += length
    return at
