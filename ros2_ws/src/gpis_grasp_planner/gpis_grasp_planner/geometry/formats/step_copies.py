"""Copies of shapes in a STEP text that are scaled or mirrored, which OpenCASCADE places wrongly.

A MAPPED_ITEM by a CARTESIAN_TRANSFORMATION_OPERATOR_3D comes out with the inverse of its scale, and
a mirrored one as turned. Copies that are only moved and turned are right.
"""

from __future__ import annotations

import re

import numpy as np

from gpis_grasp_planner.errors import ErrorCode, MeshError

# Alone, with the names of its supertypes before them, or as part of a complex instance: two or
# three axes, the origin and the scale are the last ones in both (ISO 10303-42, 4.4.11 and 4.4.12).
_OPERATOR = re.compile(rb"\bCARTESIAN_TRANSFORMATION_OPERATOR(_3D)?\s*\(([^()]*)\)")
_DIRECTION = re.compile(
    rb"#(\d+)\s*=\s*DIRECTION\s*\(\s*(?:'(?:[^']|'')*'|\$)\s*,\s*\(([^()]*)\)\s*\)"
)
_ABSENT = b"$"
_DEFAULTS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def refuse_changed_copies(text: bytes, name: str) -> None:
    """Refuse a text, without comments, that places a shape scaled or mirrored.

    Raises
    ------
    MeshError
        MESH_FORMAT_NOT_SUPPORTED.
    """
    if b"CARTESIAN_TRANSFORMATION_OPERATOR" not in text:
        return
    directions = {f"#{int(number)}": _numbers(of) for number, of in _DIRECTION.findall(text)}
    before: list[bytes] = []
    for of_3d, arguments in _OPERATOR.findall(text):
        words = [word.strip() for word in arguments.split(b",")]
        if of_3d and len(words) == 1:  # of a complex instance, whose other attributes came before
            words = before + words
        before = words
        third = words[-1] if of_3d else _ABSENT
        words = words[:-1] if of_3d else words
        first, second, _, scale = words[-4:]
        factor = 1.0 if scale == _ABSENT else float(scale)
        axes = [
            directions.get(axis.decode("latin-1"), default)
            for axis, default in zip((first, second, third), _DEFAULTS, strict=True)
        ]
        mirrored = third != _ABSENT and float(np.linalg.det(np.array(axes))) < 0.0
        if abs(factor - 1.0) > 1e-9 or mirrored:
            how = "mirrored" if mirrored else f"scaled by {factor:g}"
            raise MeshError(
                f"{name} places a copy of a shape {how} (CARTESIAN_TRANSFORMATION_OPERATOR_3D), "
                "which the reader would place wrongly. Export it with the copy as a body of its "
                "own.",
                ErrorCode.MESH_FORMAT_NOT_SUPPORTED,
            )


def _numbers(text: bytes) -> tuple[float, ...]:
    return tuple(float(word) for word in text.split(b","))
