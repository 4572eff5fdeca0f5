"""Are two places of a part the same for planning? Then a plan for one is a plan for the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.transforms import inverse, rotation_angle
from gpis_grasp_planner.surroundings.obstacles import (
    BoxObstacle,
    MeshObstacle,
    Obstacle,
    SupportPlane,
    Surroundings,
)
from gpis_grasp_planner.surroundings.place import Place

Array = NDArray[np.float64]

SUPPORT_TOLERANCE_M = 0.005
OBSTACLE_TOLERANCE_M = 0.01


def same_place(one: Place, other: Place, radius: float) -> bool:
    """Whether a plan for one place is a plan for the other; see :func:`same_surroundings`.

    Before an arm the part must lie as it did as well, to within the tolerance of a support.
    """
    arms = one.T_world_arm, other.T_world_arm
    if arms[0] is None or arms[1] is None:
        if arms[0] is not arms[1]:
            return False
    else:
        T = inverse(arms[0]) @ one.T_world_object
        T_other = inverse(arms[1]) @ other.T_world_object
        shift = float(np.linalg.norm(T[:3, 3] - T_other[:3, 3]))
        turn = float(rotation_angle(T[:3, :3], T_other[:3, :3]))
        if shift + radius * turn > SUPPORT_TOLERANCE_M:
            return False
    return same_surroundings(one.around(), other.around(), radius)


def same_surroundings(one: Surroundings, other: Surroundings, radius: float) -> bool:
    """Whether what stands around a part is the same but for small shifts.

    Parameters
    ----------
    one, other : Surroundings
        In the object's frame.
    radius : float [m]
        Of the region about the object's origin in which the planes are compared.

    Notes
    -----
    A support may have moved by 5 mm anywhere in the region, a corner of an obstacle by 10 mm.
    Clearances of the grasps are looked at anew in any case.
    """
    if len(one.obstacles) != len(other.obstacles):
        return False
    pairs = zip(one.obstacles, other.obstacles, strict=True)
    return _same_support(one.support, other.support, radius) and all(
        _same_obstacle(a, b) for a, b in pairs
    )


def _same_support(one: SupportPlane | None, other: SupportPlane | None, radius: float) -> bool:
    if one is None or other is None:
        return one is other
    shift = abs(float(one.normal @ one.point - other.normal @ other.point))
    turn = float(np.linalg.norm(one.normal - other.normal))
    return shift + radius * turn <= SUPPORT_TOLERANCE_M


def _same_obstacle(one: Obstacle, other: Obstacle) -> bool:
    if isinstance(one, BoxObstacle) and isinstance(other, BoxObstacle):
        same = bool(np.allclose(one.size, other.size, atol=1e-6))
        corners = one.corners
    elif isinstance(one, MeshObstacle) and isinstance(other, MeshObstacle):
        same = one.source == other.source
        corners = other.mesh.bounds
    else:
        return False
    moved = _points(one.pose, corners) - _points(other.pose, corners)
    return same and float(np.linalg.norm(moved, axis=1).max()) <= OBSTACLE_TOLERANCE_M


def _points(T: Array, points: Array) -> Array:
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])
