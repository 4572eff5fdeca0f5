"""XYZ: a point a line, three numbers, or six with its normal; further columns are passed over."""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.errors import MeshError
from gpis_grasp_planner.geometry.formats.parsed_cloud import (
    ParsedCloud,
    check_point_count,
    check_points,
    own_normals,
)
from gpis_grasp_planner.geometry.formats.recognise import refuse_bytes
from gpis_grasp_planner.geometry.formats.words import Words, level, without_comments

_NORMAL_COLUMNS = 6
_UNIT = 0.02  # how far a normal's length may be from 1 for six columns to be points and normals


def read_xyz(data: bytes, name: str, most: int) -> ParsedCloud:
    """Read a text of points; '#' and '//' start comments."""
    refuse_bytes(data, name, "XYZ")
    words = Words(without_comments(without_comments(level(data)), b"//"))
    firsts = words.firsts
    check_point_count(len(firsts), name, most)
    widths = np.diff(np.append(firsts, len(words)))
    width = int(widths[0])
    odd = np.flatnonzero(widths != width)
    if width < 3 or odd.size:
        row = int(odd[0]) if odd.size else 0
        raise MeshError(
            f"{name}: line {words.line(int(firsts[row]))} has {widths[row]} numbers, "
            f"{'the first has ' + str(width) if odd.size else 'a point takes 3'}. Export it again, "
            "a point a line."
        )
    count = _NORMAL_COLUMNS if width >= _NORMAL_COLUMNS else 3
    chosen = (firsts[:, None] + np.arange(count)).reshape(-1)
    values = words.picked(chosen, name, "a coordinate").reshape(-1, count)
    check_points(values[:, :3], name)
    normals = own_normals(values[:, 3:])
    if normals is not None and np.abs(np.linalg.norm(normals, axis=1) - 1.0).max() > _UNIT:
        normals = None  # colours, or whatever else
    passed = width - 3 - (0 if normals is None else 3)
    notes = (f"{passed} columns after the points were passed over.",) if passed else ()
    return ParsedCloud(np.ascontiguousarray(values[:, :3]), normals, notes=notes)
