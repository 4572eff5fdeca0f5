"""A hand whose palm does not look along its root link's z axis: its URDF turned until it does.

The planner's palm frame has z out of the palm. Where a URDF's root link has another axis there,
the frame is turned by the smallest rotation that brings the axis to z, and everything that the URDF
places in the root link with it: shapes, masses and joints. Nothing else of the hand changes, and
who reads the URDF sees the turned one.
"""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.hand.urdf_origin import move_origin

Array = NDArray[np.float64]

_Z = np.array([0.0, 0.0, 1.0])


def palm_turn(axis: ArrayLike) -> Array:
    """The smallest rotation (3, 3) that brings an axis (3,) to z; about x where it is -z.

    Raises
    ------
    ValueError
        For an axis that is no vector of three numbers, or has no length.
    """
    a = np.asarray(axis, dtype=float)
    length = float(np.linalg.norm(a))
    if a.shape != (3,) or not np.isfinite(length) or length < 1e-9:
        raise ValueError(f"palm_axis is {axis!r}; give three numbers that are not all 0")
    a = a / length
    cosine = float(a @ _Z)
    if cosine < -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    v = np.cross(a, _Z)
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))


def turn_root(robot: ET.Element, R: Array) -> None:
    """Turn the root link's frame of a URDF by R (3, 3), in place."""
    if np.array_equal(R, np.eye(3)):
        return
    T = transform(R, np.zeros(3))
    children = {joint.find("child").get("link") for joint in robot.findall("joint")}  # type: ignore[union-attr]
    for link in robot.findall("link"):
        if link.get("name") in children:
            continue
        for kind in ("visual", "collision", "inertial"):
            for element in link.findall(kind):
                move_origin(element, T)
        for joint in robot.findall("joint"):
            if joint.find("parent").get("link") == link.get("name"):  # type: ignore[union-attr]
                move_origin(joint, T)
