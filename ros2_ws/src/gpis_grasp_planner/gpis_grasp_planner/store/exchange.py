"""Kept plans as text, to carry them to another machine: one line of JSON for each plan."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.store.grasp_store import Entry
from gpis_grasp_planner.store.record import Record, parse_numbers, read_record

SCHEMA = "gpis_grasp_planner/kept_plan"
_FIELDS = {"schema", "schema_version", "made_s", "record"}
_VERSION = 1


def line_of(entry: Entry, record: Record) -> str:
    """One plan as a line without an end."""
    values = {
        "schema": SCHEMA,
        "schema_version": _VERSION,
        "made_s": entry.made_s,
        "record": record.as_mapping(),
    }
    return json.dumps(values, separators=(",", ":"), allow_nan=False)


def read_lines(path: Path) -> Iterator[tuple[Record, float]]:
    """Records of a file with the times when they were made [s since the epoch], each checked.

    Raises
    ------
    RequestError
        INVALID_DOCUMENT with the number of the line.
    """
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            if line.strip():
                yield _read(line, f"Line {number} of {path.name}")


def _read(line: str, name: str) -> tuple[Record, float]:
    try:
        values = parse_numbers(line)
    except (ValueError, RecursionError) as error:
        raise _wrong(name, f"it is not JSON: {error}") from None
    if not isinstance(values, dict) or set(values) != _FIELDS or values["schema"] != SCHEMA:
        raise _wrong(name, f"its schema is not '{SCHEMA}'")
    if values["schema_version"] != _VERSION:
        raise _wrong(name, f"its version is {values['schema_version']!r}, not {_VERSION}")
    made = values["made_s"]
    if isinstance(made, bool) or not isinstance(made, int | float) or not 0 <= made < 1e11:
        raise _wrong(name, f"made_s is {made!r}, no time since 1970")
    return read_record(values["record"], name), float(made)


def _wrong(name: str, why: str) -> RequestError:
    return RequestError(
        f"{name} is no kept plan: {why}. Name a file that 'store export' wrote.",
        ErrorCode.INVALID_DOCUMENT,
    )
