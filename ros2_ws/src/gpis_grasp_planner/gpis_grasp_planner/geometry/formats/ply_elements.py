"""The elements of a PLY file: what each holds, read from text or bytes."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.formats.parsed_mesh import Array, Index, truncated
from gpis_grasp_planner.geometry.formats.words import Words, level

PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_STRUCT = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I"}
_NOTHING = np.zeros(0, dtype=np.int64)
_NO_SCALARS = np.zeros((0, 0))


@dataclass(frozen=True)
class Property:
    """A number, or a list whose length has the type `length` ('' for a number)."""

    name: str
    type: str
    length: str


@dataclass(frozen=True)
class Element:
    """An element as the header declares it."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)

    @property
    def scalars(self) -> list[str]:
        """Names of the properties that are numbers."""
        return [p.name for p in self.properties if not p.length]

    @property
    def has_lists(self) -> bool:
        """Whether any property is a list."""
        return any(p.length for p in self.properties)

    def lists(self, names: Sequence[str]) -> list[int]:
        """The properties that are lists with one of these names."""
        return [i for i, p in enumerate(self.properties) if p.length and p.name in names]


@dataclass(frozen=True, eq=False)
class Table:
    """The wanted content of an element.

    Attributes
    ----------
    scalars : (n, k) array
        The wanted numbers; (0, 0) if there are none.
    values : (sum of counts,) int array
        The wanted lists, one after the other.
    counts : (n,) int array
        Their lengths; empty if no list is wanted.
    """

    scalars: Array
    values: Index
    counts: Index


def _columns(element: Element, names: Sequence[str]) -> list[int]:
    """The wanted numbers, in the order of their names."""
    places = {p.name: i for i, p in enumerate(element.properties) if not p.length}
    return [places[n] for n in names if n in places]


def _table(element: Element, scalars: list[float] | Array, values: Index, counts: Index) -> Table:
    numbers = np.asarray(scalars, dtype=np.float64)
    return Table(
        numbers.reshape(element.count, -1) if numbers.size else _NO_SCALARS, values, counts
    )


def read_ascii(
    data: bytes,
    start: int,
    elements: Sequence[Element],
    wanted: Mapping[str, Sequence[str]],
    name: str,
) -> tuple[dict[str, Table], str, str | None]:
    """Tables of the wanted elements, what follows them, and a doubt whether the file is whole."""
    words = Words(level(data)[start:], data.count(b"\n", 0, start))
    tables: dict[str, Table] = {}
    at = 0
    for element in elements:
        names = wanted.get(element.name, ())
        if not element.has_lists:
            width = len(element.properties)
            end = at + element.count * width
            if end > len(words):
                raise _short(name, element, (len(words) - at) // max(width, 1))
            if names:
                columns = np.array(sorted(_columns(element, names)), dtype=np.int64)
                chosen = at + width * np.arange(element.count)[:, None] + columns
                scalars = words.picked(chosen.reshape(-1), name, "a coordinate")
                order = np.argsort(np.argsort(_columns(element, names)))
                table = _table(element, scalars, _NOTHING, _NOTHING)
                tables[element.name] = Table(table.scalars[:, order], _NOTHING, _NOTHING)
            at = end
            continue
        table, at = _ascii_lists(words, at, element, names, name)
        tables[element.name] = table
    extra = f"{len(words) - at} words" if at < len(words) else ""
    doubt = "words follow what its header describes" if extra else None
    if not data.endswith((b"\n", b"\r")):
        doubt = doubt or "it ends without a newline, perhaps within its last number"
    return tables, extra, doubt


def _ascii_lists(
    words: Words, at: int, element: Element, names: Sequence[str], name: str
) -> tuple[Table, int]:
    """One element with lists. Word by word where rows are not lines with one list alone."""
    chosen = next(iter(element.lists(names)), None)
    columns = _columns(element, names)
    rest = words.leading_numbers(at)
    if chosen is not None and not columns:
        found = _rows_at_once(rest, words.firsts[words.firsts >= at] - at, element, chosen)
        if found is not None:
            return found[0], at + found[1]
    values = rest.tolist()
    parts: list[int] = []
    counts: list[int] = []
    position = 0
    scalars: list[list[float]] = [[] for _ in columns]
    for row in range(element.count):
        for i, p in enumerate(element.properties):
            if not p.length:
                if i in columns and position < len(values):
                    scalars[columns.index(i)].append(values[position])
                position += 1
                continue
            if position >= len(values):
                raise _short(name, element, row)
            count = values[position]
            if count < 0 or count != int(count):
                raise truncated(name, f"{element.name} {row + 1} has a list of {count:g} entries")
            position += 1
            if i == chosen:
                parts.append(position)
                counts.append(int(count))
            position += int(count)
        if position > len(values):
            raise _short(name, element, row)
    lengths = np.array(counts, dtype=np.int64)
    index = np.repeat(np.array(parts, dtype=np.int64), lengths) + _ranks(lengths)
    indices = rest[index]
    whole = indices.astype(np.int64)
    wrong = np.flatnonzero(whole != indices)
    if wrong.size:
        raise truncated(name, f"a face has the vertex index {indices[wrong[0]]:g}")
    return _table(element, np.array(scalars).T, whole, lengths), at + position


def _rows_at_once(
    rest: Array, line_starts: Index, element: Element, chosen: int
) -> tuple[Table, int] | None:
    """Read rows with one list that are lines, or all equally long; None where they are not."""
    width, count = len(element.properties), element.count
    if sum(1 for p in element.properties if p.length) != 1 or count == 0 or len(rest) <= chosen:
        return None
    step = width + int(rest[chosen])
    starts = step * np.arange(count)
    if starts[-1] + chosen >= len(rest) or (rest[starts + chosen] != rest[chosen]).any():
        starts = line_starts[:count]
        if len(starts) < count or starts[-1] + chosen >= len(rest):
            return None
    sizes = rest[starts + chosen]
    lengths = sizes.astype(np.int64)
    ends = starts + width + lengths
    if (lengths != sizes).any() or (lengths < 0).any() or (ends[:-1] != starts[1:]).any():
        return None
    if ends[-1] > len(rest):
        return None
    index = np.repeat(starts + chosen + 1, lengths) + _ranks(lengths)
    values = rest[index].astype(np.int64)
    if (values != rest[index]).any():
        return None
    return Table(_NO_SCALARS, values, lengths), int(ends[-1])


def _ranks(lengths: Index) -> Index:
    return np.arange(int(lengths.sum())) - np.repeat(np.cumsum(lengths) - lengths, lengths)


def read_binary(
    data: bytes,
    start: int,
    elements: Sequence[Element],
    wanted: Mapping[str, Sequence[str]],
    order: str,
    name: str,
) -> tuple[dict[str, Table], str, str | None]:
    """As :func:`read_ascii`, from bytes of the order '<' or '>'."""
    tables: dict[str, Table] = {}
    at = start
    for element in elements:
        names = wanted.get(element.name, ())
        if element.has_lists:
            tables[element.name], at = _binary_lists(data, at, element, names, order, name)
            continue
        fields = [(f"{i}", order + p.type) for i, p in enumerate(element.properties)]
        row = np.dtype(fields)
        end = at + element.count * row.itemsize
        if end > len(data):
            raise _short(name, element, (len(data) - at) // max(row.itemsize, 1))
        if names:
            rows = np.frombuffer(data, row, element.count, at)
            read = [rows[f"{c}"].astype(np.float64) for c in _columns(element, names)]
            tables[element.name] = _table(element, np.array(read).T, _NOTHING, _NOTHING)
        at = end
    extra = len(data) - at
    blank = not data[at : at + 64].strip(b"\r\n \0") and extra < 64
    doubt = None if blank else "bytes follow what its header describes"
    return tables, f"{extra} bytes" if extra else "", doubt


def _binary_lists(
    data: bytes, at: int, element: Element, names: Sequence[str], order: str, name: str
) -> tuple[Table, int]:
    chosen = next(iter(element.lists(names)), None)
    columns = _columns(element, names)
    found = _all_equal(data, at, element, chosen, order) if chosen is not None else None
    if found is not None and not columns:
        return found
    if chosen is not None and not columns and element.properties[chosen].length == "u1":
        found = _one_list(data, at, element, chosen, order, name)
        if found is not None:
            return found
    starts, end = _walk(data, at, element, order, name)
    scalars = []
    for c in columns:
        kind = np.dtype(order + element.properties[c].type)
        scalars.append(_gathered(data, np.array([s[0] for s in starts[c]], dtype=np.int64), kind))
    values, lengths = _NOTHING, _NOTHING
    if chosen is not None:
        item = np.dtype(order + element.properties[chosen].type)
        first = np.array([s[0] for s in starts[chosen]], dtype=np.int64)
        lengths = np.array([s[1] for s in starts[chosen]], dtype=np.int64)
        offsets = np.repeat(first, lengths) + item.itemsize * _ranks(lengths)
        values = _gathered(data, offsets, item).astype(np.int64)
    return _table(element, np.array(scalars, dtype=np.float64).T, values, lengths), end


def _gathered(data: bytes, offsets: Index, kind: np.dtype[Any]) -> NDArray[Any]:
    """Numbers of one kind at offsets of any alignment."""
    raw = np.frombuffer(data, np.uint8)[offsets[:, None] + np.arange(kind.itemsize)]
    return raw.reshape(-1).view(kind)


def _all_equal(
    data: bytes, at: int, element: Element, chosen: int, order: str
) -> tuple[Table, int] | None:
    """Read rows at once that all have one list of the same length; None where they do not."""
    if sum(1 for p in element.properties if p.length) != 1 or element.count == 0:
        return None
    lead = sum(np.dtype(p.type).itemsize for p in element.properties[:chosen])
    p = element.properties[chosen]
    head = np.dtype(order + p.length)
    if at + lead + head.itemsize > len(data):
        return None
    count = int(np.frombuffer(data, head, 1, at + lead)[0])
    if count < 0 or count > 1_000_000:
        return None
    fields = [
        (f"{i}", order + q.type) if i != chosen else (f"{i}", order + q.type, (count,))
        for i, q in enumerate(element.properties)
    ]
    fields.insert(chosen, ("count", order + p.length))
    row = np.dtype(fields)
    end = at + element.count * row.itemsize
    if end > len(data):
        return None
    rows = np.frombuffer(data, row, element.count, at)
    if (rows["count"] != count).any():
        return None
    values = rows[f"{chosen}"].astype(np.int64).reshape(-1)
    lengths = np.full(element.count, count, dtype=np.int64)
    return Table(_NO_SCALARS, values, lengths), end


def _one_list(
    data: bytes, at: int, element: Element, chosen: int, order: str, name: str
) -> tuple[Table, int] | None:
    """Read rows with one list whose length is a byte: the commonest, ten times as fast."""
    if sum(1 for p in element.properties if p.length) != 1:
        return None
    item = np.dtype(order + element.properties[chosen].type)
    sizes = [np.dtype(p.type).itemsize for p in element.properties]
    lead, rest = sum(sizes[:chosen]), sum(sizes) - item.itemsize + 1
    starts = []
    step = item.itemsize
    try:
        for _ in range(element.count):
            starts.append(at)
            at += rest + step * data[at + lead]
    except IndexError:
        raise _short(name, element, len(starts) - 1) from None
    if at > len(data):
        raise _short(name, element, len(starts) - 1)
    first = np.array(starts, dtype=np.int64) + lead
    lengths = np.frombuffer(data, np.uint8)[first].astype(np.int64)
    offsets = np.repeat(first + 1, lengths) + step * _ranks(lengths)
    return Table(_NO_SCALARS, _gathered(data, offsets, item).astype(np.int64), lengths), at


def _walk(
    data: bytes, at: int, element: Element, order: str, name: str
) -> tuple[list[list[tuple[int, int]]], int]:
    """Starts and lengths of each property's entries, row by row, and the end of the element."""
    steps = [
        (struct.Struct(order + _STRUCT[p.length]) if p.length else None, np.dtype(p.type).itemsize)
        for p in element.properties
    ]
    starts: list[list[tuple[int, int]]] = [[] for _ in steps]
    size = len(data)
    for row in range(element.count):
        for i, (length, item) in enumerate(steps):
            count = 1
            if length is not None:
                if at + length.size > size:
                    raise _short(name, element, row)
                count = length.unpack_from(data, at)[0]
                at += length.size
                if count < 0:
                    raise truncated(name, f"{element.name} {row + 1} has a list of {count} entries")
            starts[i].append((at, count))
            at += item * count
        if at > size:
            raise _short(name, element, row)
    return starts, at


def _short(name: str, element: Element, found: int) -> Exception:
    return truncated(
        name,
        f"its header promises {element.count} of element '{element.name}', the file ends after "
        f"{found}",
    )
