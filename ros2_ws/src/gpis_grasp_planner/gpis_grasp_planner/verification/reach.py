"""Which part of a mesh a closing hand may touch, for covers that are made of no more than that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.transforms import apply
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.drive import joints_from_motors, motors_from_joints
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.surface_points import SurfacePoints
from gpis_grasp_planner.scene.arrays import kept_surface_points

Array = NDArray[np.float64]

_POSTURES = 6
_POSTURES_BY_ROWS = 12


@dataclass(frozen=True)
class Allowance:
    """How much of a part a trial has to know about the place where the hand closes.

    Attributes
    ----------
    distance_m : float [m]
        From the hand's sweep.
    farther_rad : float [rad]
        Fingers may close farther than was planned.
    """

    distance_m: float
    farther_rad: float


# A part that lies where it was planned and holds moves by a few millimetres in the hand.
NEAR = Allowance(0.006, 0.05)
# One that lies elsewhere lets the fingers close farther; one that slips is followed until it has
# left the hand.
FAR = Allowance(0.02, 0.3)


@dataclass(frozen=True, eq=False)
class Reach:
    """Finds the triangles near the sweep of a closing hand.

    Attributes
    ----------
    hand : HandDescription
    points : SurfacePoints
        Of the hand.
    middles : (m, 3) array [m]
        Of the mesh's triangles.
    radii : (m,) array [m]
        Of balls about the middles that hold the triangles.
    """

    hand: HandDescription
    points: SurfacePoints
    middles: Array
    radii: Array

    @classmethod
    def of(cls, hand: HandDescription, mesh: TriangleMesh) -> Reach:
        """Prepare a mesh, some 0.1 us a triangle."""
        triangles = mesh.triangles
        middles = triangles.mean(axis=1)
        radii = np.linalg.norm(triangles - middles[:, None], axis=2).max(axis=1)
        return cls(hand, kept_surface_points(hand), middles, radii)

    def faces(
        self, T_object_palm: Array, start: Array, closed: Array, allowance: Allowance
    ) -> NDArray[np.bool_]:
        """Triangles (m,) that the hand may touch between two postures (J,) [rad].

        No triangle within the distance of a sampled posture is missed. Samples are near each other
        towards the end, where the contacts are.
        """
        distance = allowance.distance_m
        end = np.array(closed, dtype=float)
        for finger, unit in zip(self.hand.fingers, self.hand.closing_unit, strict=True):
            end[list(finger.joints)] += allowance.farther_rad * unit
        end = np.minimum(np.maximum(start, end), self.hand.joint_upper)
        if self.hand.drive.advances_at_stop:  # joints move one after the other
            held = self.hand.of_fingers(np.array(closed, dtype=float))[None, :, :-1]
            shape, first = motors_from_joints(self.hand, start)
            _, last = motors_from_joints(self.hand, closed)
            share = np.linspace(0.0, 1.0, _POSTURES_BY_ROWS)[:, None]
            motors = first + share * (last - first)
            law = joints_from_motors(self.hand, np.repeat(shape, len(motors), 0), motors, held)
            way = np.concatenate([end[None], law])
        else:
            way = end + np.linspace(1.0, 0.0, _POSTURES)[:, None] ** 2 * (start - end)
        poses = link_transforms(self.hand, way)
        offsets = self.points.offsets
        swept = np.concatenate(
            [
                np.concatenate([apply(T, self.points.points[offsets[k] : offsets[k + 1]])])
                for k in range(self.hand.n_links)
                for T in (T_object_palm @ poses[:, k])
            ]
        )
        low = swept.min(axis=0) - distance
        high = swept.max(axis=0) + distance
        near = (
            (self.middles + self.radii[:, None] >= low)
            & (self.middles - self.radii[:, None] <= high)
        ).all(axis=1)
        rows = np.flatnonzero(near)
        gap, _ = KDTree(swept).query(
            self.middles[rows], distance_upper_bound=distance + float(self.radii.max(initial=0.0))
        )
        near[rows] = gap <= distance + self.radii[rows]
        return near
