"""The poses in which a part comes to rest on a plane, with their probabilities.

A part that falls with a random orientation first meets the plane with the face of its hull below
its centre of mass, and rolls on while the centre is not over that face; its probability is the
solid angle of the orientations that end there (Goldberg, Mirtich, Zhuang, Craig, Carlisle and
Canny, "Part pose statistics", IEEE Trans. Robotics and Automation 15, 1999). Rolling is slow, and
goes from a face to the one that the plumb line through the centre leaves the hull by.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.surroundings.obstacles import SupportPlane, Surroundings
from gpis_grasp_planner.surroundings.place import Place

_DIRECTIONS = 20_000
_SAME_FACE = np.cos(np.deg2rad(2.0))


@dataclass(frozen=True)
class RestingPose:
    """Which way is up for the part, (3,) in its own frame, and how often it comes to rest so."""

    up: NDArray[np.float64]
    probability: float


def resting_poses(vertices: NDArray[np.float64], center: NDArray[np.float64]) -> list[RestingPose]:
    """Resting poses of a part, the most probable first.

    Parameters
    ----------
    vertices : (n, 3) array [m]
    center : (3,) array [m]
        The centre of mass, inside of the hull.

    Notes
    -----
    Faces within 2 degrees count as one. 20,000 directions give a probability to some 0.003.
    """
    faces = np.unique(np.round(ConvexHull(vertices - center).equations, 7), axis=0)
    normals, heights = faces[:, :3], -faces[:, 3]
    falls_to = _pierced(normals, normals, heights)
    while not np.array_equal(falls_to[falls_to], falls_to):
        falls_to = falls_to[falls_to]
    ends = falls_to[_pierced(_even_directions(_DIRECTIONS), normals, heights)]
    found, counts = np.unique(ends, return_counts=True)
    poses: list[RestingPose] = []
    for face, count in sorted(zip(found, counts, strict=True), key=lambda pair: -pair[1]):
        up, share = -normals[face], float(count / _DIRECTIONS)
        for k, pose in enumerate(poses):
            if pose.up @ up > _SAME_FACE:
                poses[k] = RestingPose(pose.up, pose.probability + share)
                break
        else:
            poses.append(RestingPose(up, share))
    return sorted(poses, key=lambda pose: -pose.probability)


def _pierced(directions, normals, heights):
    """The face that a ray from the centre leaves the hull by, for each direction (n, 3)."""
    slope = directions @ normals.T
    distance = np.where(slope > 1e-9, heights / np.maximum(slope, 1e-9), np.inf)
    # A face that the centre stands over is its own nearest: rounding must not say otherwise.
    return np.argmin(np.round(distance, 9), axis=1)


def _even_directions(n: int) -> NDArray[np.float64]:
    """Unit vectors (n, 3), evenly spread by the golden spiral."""
    k = np.arange(n) + 0.5
    z = 1.0 - 2.0 * k / n
    turn = np.pi * (1.0 + np.sqrt(5.0)) * k
    radius = np.sqrt(1.0 - z**2)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)


def place_at_rest(part: Part, where: str = "table") -> Place:
    """The part on a plane in its most probable resting pose, or "free"."""
    if where == "free":
        return Place()
    up = resting_poses(part.mesh.vertices, part.center_of_mass)[0].up
    height = float((part.mesh.vertices @ up).min())
    return Place(surroundings=Surroundings(SupportPlane(up * height, up)))
