"""Copies of shapes in a STEP text that are scaled or mirrored, which OpenCASCADE places wrongly.

A MAPPED_ITEM by a CARTESIAN_TRANSFORMATION_OPERATOR_3D comes out with the inverse of its scale, and
a mirrored one as turned. Copies that are only moved and turned are right.
"""

from __future__ import annotations

import re

import numpy as np

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.formats.parsed_mesh import truncated

_KIND = b"CARTESIAN_TRANSFORMATION_OPERATOR"
_ENTITY = re.compile(rb"#(\d+)\s*=([^;]*" + _KIND + rb"[^;]*);")
# Alone, all attributes are in one list; in a complex instance the third axis is in one of its own.
_ATTRIBUTES = re.compile(_KIND + rb"(?:_3D)?\s*\(([^()]*)\)")
_MAPPED = re.compile(rb"\bMAPPED_ITEM\s*\([^;]*#(\d+)\s*\)")
_DIRECTION = re.compile(rb"#(\d+)\s*=\s*DIRECTION\s*\([^;(]*\(([^()]*)\)\s*\)")
_ABSENT = b"$"
_SAME_SCALE = 1e-9


def refuse_changed_copies(text: bytes, name: str) -> None:
    """Refuse a text, without comments, that places a shape scaled or mirrored.

    Raises
    ------
    MeshError
        MESH_FORMAT_NOT_SUPPORTED; MESH_UNREADABLE where the way of a copy cannot be read.
    """
    if _KIND not in text:
        return
    directions = {b"#" + number: of for number, of in _DIRECTION.findall(text)}
    used = set(_MAPPED.findall(text))
    for number, entity in _ENTITY.findall(text):
        if number not in used:
            continue
        try:
            how = _change(entity, directions)
        except (ValueError, KeyError):
            raise truncated(name, f"the way of a copy (#{number.decode()}) is damaged") from None
        if how:
            raise MeshError(
                f"{name} places a copy of a shape {how} (CARTESIAN_TRANSFORMATION_OPERATOR_3D), "
                "which the reader would place wrongly. Export it with the copy as a body of its "
                "own.",
                ErrorCode.MESH_FORMAT_NOT_SUPPORTED,
            )


def _change(entity: bytes, directions: dict[bytes, bytes]) -> str:
    """How an operator changes a shape beside moving and turning it; "" where it does not."""
    attributes = b",".join(_ATTRIBUTES.findall(entity)).split(b",")
    first, second, _, scale, third = (word.strip() for word in attributes[-5:])
    factor = 1.0 if scale == _ABSENT else float(scale)
    if abs(factor - 1.0) > _SAME_SCALE:
        return f"scaled by {factor:g}"
    axes = [
        [float(x) for x in directions[axis].split(b",")] if axis != _ABSENT else default
        for axis, default in zip((first, second, third), np.eye(3).tolist(), strict=True)
    ]
    return "mirrored" if float(np.linalg.det(np.array(axes))) < 0.0 else ""
