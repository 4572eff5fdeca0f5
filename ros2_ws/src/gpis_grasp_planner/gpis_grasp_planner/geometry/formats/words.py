"""Words and numbers of a text, found and read by numpy: some 4 million numbers a second.

Line ends and byte order marks are levelled without moving a byte, so that a place in the
levelled text is the same place in the file, and a message can name its line.
"""

from __future__ import annotations

import re
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.formats.recognise import BYTE_ORDER_MARK

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Bytes = NDArray[np.uint8]

BLANK = 32
NEWLINE = 10
_IS_BLANK = np.zeros(256, dtype=bool)
_IS_BLANK[[9, 10, 11, 12, 13, 32]] = True
_NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_NOT_FINITE = re.compile(
    rb"[+-]?(nan(\(\w*\))?|inf(inity)?|\d*\.?\d*#(inf|ind|qnan|snan)\w*)", re.I
)
_DECIMAL_COMMA = re.compile(rb"[+-]?\d*,\d+([eE][+-]?\d+)?")


def level(data: bytes) -> bytes:
    """The text with newlines as line ends and without byte order mark, every byte in its place."""
    if data.startswith(BYTE_ORDER_MARK):
        data = b"   " + data[3:]
    if b"\r" in data:
        data = data.replace(b"\r\n", b" \n").replace(b"\r", b"\n")
    return data


def without_comments(text: bytes, mark: bytes = b"#") -> bytes:
    """The levelled text with blanks in place of everything from `mark` to the line's end."""
    if mark not in text:
        return text
    pattern = re.escape(mark) + rb"[^\n]*"
    return re.sub(pattern, lambda m: b" " * len(m[0]), text)


class Words:
    """The words of a text between blanks.

    Parameters
    ----------
    text : bytes
    lines_before : int
        Lines of the file before this text, for messages.

    Attributes
    ----------
    bytes : (n,) uint8 array
    starts, ends : (w,) int arrays
        Where each word starts, and where it has ended.
    """

    def __init__(self, text: bytes, lines_before: int = 0):
        self.text = text
        self._lines_before = lines_before
        self.bytes: Bytes = np.frombuffer(text, dtype=np.uint8)
        blank = np.ones(len(text) + 2, dtype=bool)
        blank[1:-1] = _IS_BLANK[self.bytes]
        change = np.flatnonzero(blank[1:] != blank[:-1])
        self.starts: Index = change[0::2]
        self.ends: Index = change[1::2]

    def __len__(self) -> int:
        return len(self.starts)

    def word(self, i: int) -> bytes:
        """Word `i`."""
        return self.text[self.starts[i] : self.ends[i]]

    @cached_property
    def newlines(self) -> Index:
        """Where the lines end."""
        return np.flatnonzero(self.bytes == NEWLINE)

    @cached_property
    def lines(self) -> Index:
        """The line of each word, counted from 0; (w,)."""
        return np.searchsorted(self.newlines, self.starts)

    @cached_property
    def firsts(self) -> Index:
        """The first word of each line that has any."""
        return np.flatnonzero(np.diff(self.lines, prepend=-1) > 0)

    def line(self, i: int) -> int:
        """The line of the file that word `i` stands in, counted from 1."""
        return 1 + self._lines_before + self.text.count(b"\n", 0, int(self.starts[i]))

    def leading_numbers(self, first: int) -> Array:
        """The words from `first` on as numbers, up to the first that is none."""
        part = self.text[self.starts[first] :] if first < len(self) else b""
        values = _read(part, len(self) - first, np.float64)
        if values is not None:
            return values
        bad = next(i for i in range(first, len(self)) if not _NUMBER.fullmatch(self.word(i)))
        return self.picked(np.arange(first, bad), "", "")

    def picked(self, chosen: Index, name: str, where: str) -> Array:
        """The words `chosen` (sorted) as numbers; `where` says what they are in an error."""
        values = _read(self._only(self.starts[chosen], self.ends[chosen]), len(chosen), np.float64)
        if values is None:
            raise self._number_error(chosen, name, where)
        return values

    def picked_integers(self, chosen: Index, ends: Index) -> Index | None:
        """The words `chosen`, read up to `ends`, as integers; None if one is something else."""
        return _read(self._only(self.starts[chosen], ends), len(chosen), np.int64)

    def _only(self, starts: Index, ends: Index) -> bytes:
        """The text with blanks in place of all that does not lie between `starts` and `ends`."""
        if len(starts) == 0:
            return b""
        first, end = int(starts[0]), int(ends[-1])
        change = np.zeros(end - first + 1, dtype=np.int8)
        change[starts - first] += 1
        change[ends - first] -= 1
        inside = np.cumsum(change[:-1], dtype=np.int8).view(bool)
        return np.where(inside, self.bytes[first:end], np.uint8(BLANK)).tobytes()

    def _number_error(self, chosen: Index, name: str, where: str) -> MeshError:
        """The error of the first of the words `chosen` that is no number."""
        for i in chosen:
            word = self.word(int(i))
            if _NUMBER.fullmatch(word) is None:
                return _bad_number(word, name, f"{where} (line {self.line(int(i))})")
        return MeshError(f"{name}: {where} cannot be read as numbers. Export it again.")


def _read(text: bytes, count: int, dtype: type) -> NDArray[Any] | None:
    if count == 0:
        return np.zeros(0, dtype=dtype)
    try:
        values: NDArray[Any] = np.fromstring(text, dtype=dtype, sep=" ")
    except (ValueError, DeprecationWarning):
        return None
    return values if len(values) == count else None


def _bad_number(word: bytes, name: str, where: str) -> MeshError:
    shown = word[:20].decode("ascii", "replace")
    if _NOT_FINITE.fullmatch(word):
        return MeshError(
            f"{name}: {where} is not finite ({shown!r}). Repair the mesh and export it again.",
            ErrorCode.MESH_NOT_FINITE,
        )
    if _DECIMAL_COMMA.fullmatch(word):
        return MeshError(
            f"{name}: {where} has a decimal comma ({shown!r}). Export it again with a decimal "
            "point (the exporter's language or number format)."
        )
    return MeshError(f"{name}: {where} is {shown!r}, which is no number. Export it again.")
