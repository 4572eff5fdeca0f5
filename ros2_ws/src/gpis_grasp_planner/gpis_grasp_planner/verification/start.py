"""Where a trial starts: fingers as far closed as they travel without meeting the part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.transforms import apply
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.drive import joints_from_motors, motors_from_joints
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.surface_points import SurfacePoints
from gpis_grasp_planner.scene.arrays import kept_surface_points

Array = NDArray[np.float64]

_CLEARANCE_M = 0.003
_TRAVEL_STEP_RAD = 0.02
_BACK_STEP_M = 0.0005


@dataclass(frozen=True, eq=False)
class StartFinder:
    """Clearances of a hand's surface points from one part.

    Parameters
    ----------
    hand : HandDescription
    field : DistanceField
        Of the part.
    """

    hand: HandDescription
    field: DistanceField
    points: SurfacePoints

    @staticmethod
    def of(hand: HandDescription, field: DistanceField) -> StartFinder:
        """Sample the hand's surface."""
        return StartFinder(hand, field, kept_surface_points(hand))

    def clearance(self, T_object_palm: Array, joints: Array, links: list[int]) -> Array:
        """Smallest distance [m] of some links from the part for joints (B, J): (B,)."""
        poses = link_transforms(self.hand, joints)
        smallest = np.full(len(poses), np.inf)
        for link in links:
            rows = slice(self.points.offsets[link], self.points.offsets[link + 1])
            points = self.points.points[rows]
            placed = points @ poses[:, link, :3, :3].transpose(0, 2, 1)
            placed += poses[:, link, None, :3, 3]
            distances = self.field.value(apply(T_object_palm, placed.reshape(-1, 3)))
            smallest = np.minimum(smallest, distances.reshape(len(poses), -1).min(axis=1))
        return smallest

    def start_joints(self, T_object_palm: Array, pregrasp_joints: Array) -> Array:
        """The pre-grasp with each finger closed until it is 3 mm from the part, (J,) [rad].

        That far the fingers travel freely, so that it needs no physics.
        """
        joints = np.array(pregrasp_joints, dtype=float)
        drive = self.hand.drive
        shape, start = motors_from_joints(self.hand, joints)
        for index, finger in enumerate(self.hand.fingers):
            unit = self.hand.closing_unit[index]
            if drive.advances_at_stop:
                first, upper = float(start[0, index]), float(drive.motor_upper[index])
            else:  # by the first row alone
                first = float(pregrasp_joints[finger.inner_joint])
                upper = float(self.hand.joint_upper[finger.inner_joint])
            travel = np.append(np.arange(first, upper, _TRAVEL_STEP_RAD * unit), max(first, upper))
            closing = np.repeat(joints[None], len(travel), axis=0)
            members = list(finger.joints)
            if drive.advances_at_stop:
                motors = np.zeros((len(travel), len(self.hand.fingers)))
                motors[:, index] = travel
                shapes = np.repeat(shape, len(travel), axis=0)
                law = joints_from_motors(self.hand, shapes, motors)[:, members]
            else:
                law = travel[:, None] * finger.closing_ratio[0]
            closing[:, members] = np.maximum(law, joints[members])
            near = self.clearance(T_object_palm, closing, list(finger.links))
            met = np.flatnonzero(near < _CLEARANCE_M)
            # a finger that meets nothing stays where it is seen to be free
            last = max(int(met[0]) - 1, 0) if len(met) else len(travel) - 1
            joints = closing[last]
        return joints

    def together(self, T_object_palm: Array, pregrasp_joints: Array) -> Array:
        """The pre-grasp with all fingers closed alike until one is 3 mm from the part, (J,) [rad].

        As :meth:`start_joints`, but the fingers keep their leads: who comes first comes first.
        """
        hand, drive = self.hand, self.hand.drive
        shape, start = motors_from_joints(hand, np.array(pregrasp_joints, dtype=float))
        upper = np.asarray(drive.motor_upper, dtype=float)
        way = np.arange(0.0, float(upper.max()), _TRAVEL_STEP_RAD)[:, None] * hand.closing_unit
        motors = np.minimum(start + way, np.maximum(upper, start))
        closing = joints_from_motors(hand, np.repeat(shape, len(way), axis=0), motors)
        links = [link for finger in hand.fingers for link in finger.links]
        met = np.flatnonzero(self.clearance(T_object_palm, closing, links) < _CLEARANCE_M)
        last = max(int(met[0]) - 1, 0) if len(met) else len(way) - 1
        return np.array(pregrasp_joints if last == 0 else closing[last], dtype=float)

    def back_until_free(self, T_object_palm: Array, joints: Array, farthest: float) -> Array | None:
        """The palm pose moved back along its -z until the hand is free; None beyond `farthest`.

        What a guarded approach does when the part lies nearer than was thought.
        """
        links = list(range(self.hand.n_links))
        back = np.array(T_object_palm, dtype=float)
        while self.clearance(back, joints[None], links)[0] < 0.0:
            back[:3, 3] -= _BACK_STEP_M * back[:3, 2]
            if np.linalg.norm(back[:3, 3] - T_object_palm[:3, 3]) > farthest:
                return None
        return back
