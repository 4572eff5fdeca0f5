"""Where an element of a URDF is: its <origin>, read and moved."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.transforms import rotation_from_rpy, transform

Array = NDArray[np.float64]


def numbers(text: str) -> Array:
    """The numbers of an attribute."""
    return np.array([float(word) for word in text.split()])


def origin_of(element: ET.Element) -> Array:
    """Pose (4, 4) by an element's <origin>; the identity without one."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    R = rotation_from_rpy(numbers(origin.get("rpy", "0 0 0")))
    return transform(R, numbers(origin.get("xyz", "0 0 0")))


def move_origin(element: ET.Element, T: Array) -> None:
    """Move an element by T (4, 4), in place: its pose becomes T times what it was."""
    origin = element.find("origin")
    if origin is None:
        origin = ET.Element("origin")
        element.insert(0, origin)
    moved = T @ origin_of(element)
    origin.set("xyz", _text(moved[:3, 3]))
    origin.set("rpy", _text(_rpy_of(moved[:3, :3])))


def _rpy_of(R: Array) -> Array:
    """Roll, pitch and yaw (3,) of a rotation (3, 3), as `rotation_from_rpy` takes them."""
    level = float(np.hypot(R[0, 0], R[1, 0]))
    pitch = np.arctan2(-R[2, 0], level)
    if level < 1e-12:  # straight up or down: roll and yaw are one
        return np.array([0.0, pitch, np.arctan2(-R[0, 1], R[1, 1])])
    return np.array([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])


def _text(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)
