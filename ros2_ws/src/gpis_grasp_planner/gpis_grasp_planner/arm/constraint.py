"""The arm that carries the hand, as a constraint: a grasp that it cannot carry out is blocked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.arm.collision import ArmCollision
from gpis_grasp_planner.arm.description import ArmDescription
from gpis_grasp_planner.arm.inverse import ArmInverse
from gpis_grasp_planner.arm.kinematics import largest_manipulability, manipulability
from gpis_grasp_planner.arm.settings import ArmSettings
from gpis_grasp_planner.arm.straight_way import follow, straight_line
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.transforms import inverse
from gpis_grasp_planner.grasp.arm_motion import ArmMotion
from gpis_grasp_planner.grasp.constraint import ClosedHands, Constraint, Verdict
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.surroundings.clearance import Cause
from gpis_grasp_planner.surroundings.place import Place

Array = NDArray[np.float64]

# Order of the causes: the farther a way comes before it ends, the more it says.
_PROGRESS = (
    Cause.ARM_REACH,
    Cause.ARM_LIMITS,
    Cause.ARM_APPROACH,
    Cause.ARM_LIFT,
    Cause.ARM_COLLISION,
)
_REMEMBERED = 4096


class ArmConstraint(Constraint):
    """Implements `grasp.constraint.Constraint` for one arm, hand, part and place.

    Before the closing: some posture within the joints' limits reaches the palm at the grasp, and
    one at the pre-grasp. After it: one branch does both and all between, lifts the hand, and
    keeps the margin on the way.

    Parameters
    ----------
    arm : ArmDescription
    hand : HandDescription
    part : TriangleMesh
        Simplified or not; in its own frame.
    place : Place
        With the arm's frame in its world (`Place.T_world_arm`); without, they are the same.
    settings : ArmSettings
    retreat_m : float [m]
        Length of the approach, along the palm's z.

    Raises
    ------
    RequestError
        If the extra 'arm' is not installed or the arm is of no known family.
    """

    def __init__(
        self,
        arm: ArmDescription,
        hand: HandDescription,
        part: TriangleMesh,
        place: Place,
        settings: ArmSettings,
        retreat_m: float,
    ):
        self.arm, self._settings, self._retreat = arm, settings, retreat_m
        self.inverse = ArmInverse(arm, settings.locked_values)
        T_world_arm = np.eye(4) if place.T_world_arm is None else place.T_world_arm
        T_base_world = inverse(T_world_arm @ arm.T_arm_base)
        self._T_base_object = T_base_world @ place.T_world_object
        self._T_palm_flange = inverse(arm.T_flange_palm)
        self._collision = ArmCollision(
            arm,
            hand,
            place.surroundings.moved(T_base_world),
            part,
            self._T_base_object,
            settings.margin_m,
        )
        support = place.around().support
        self._lift_direction = None if support is None else support.normal
        self._largest = largest_manipulability(arm.chain)
        self._known: dict[bytes, tuple[Cause | None, ArmMotion | None]] = {}

    @property
    def name(self) -> str:
        """What the constraint is called in counts."""
        return "arm"

    def allows(self, T_object_palm: Array, _joints: Array, /) -> NDArray[np.bool_]:
        """Which palms (B, 4, 4) the arm reaches within its limits, here and at the pre-grasp."""
        return self.allows_palm(T_object_palm, _joints)

    def allows_palm(self, T_object_palm: Array, _joints: Array, /) -> NDArray[np.bool_]:
        """The same: the fingers have no part in it (B,)."""
        free = self.inverse.reachable(self._flanges(T_object_palm))
        back = np.array(T_object_palm[free])
        back[:, :3, 3] -= self._retreat * back[:, :3, 2]
        free[free] = self.inverse.reachable(self._flanges(back))
        return free

    def verdict(self, closed: ClosedHands) -> Verdict:
        """Which closed hands the arm cannot bring and lift, and why."""
        verdict = Verdict.clear(len(closed))
        for row in range(len(closed)):
            cause, _ = self.motion(
                closed.T_object_palm[row], (closed.start_joints[row], closed.joints[row])
            )
            verdict.cause[row] = cause
        return verdict

    def carried(self, grasps: Sequence[Grasp]) -> list[Grasp]:
        """The grasps with the arm's way to them; without one where there is none."""
        return [
            replace(
                grasp,
                arm=self.motion(grasp.T_object_palm, (grasp.pregrasp_joints, grasp.joints))[1],
            )
            for grasp in grasps
        ]

    def motion(
        self, T_object_palm: Array, postures: tuple[Array, Array]
    ) -> tuple[Cause | None, ArmMotion | None]:
        """The arm's way to a palm (4, 4) and its lift, or why there is none.

        Of all ways that are free the one with the largest manipulability at the grasp.

        Parameters
        ----------
        T_object_palm : (4, 4) array
        postures : two (J,) arrays [rad]
            The hand in its pre-grasp, and closed.
        """
        key = T_object_palm.tobytes() + postures[0].tobytes() + postures[1].tobytes()
        if key not in self._known:
            while len(self._known) >= _REMEMBERED:
                self._known.pop(next(iter(self._known)))
            self._known[key] = self._motion(T_object_palm, postures)
        return self._known[key]

    def _motion(
        self, T_object_palm: Array, postures: tuple[Array, Array]
    ) -> tuple[Cause | None, ArmMotion | None]:
        step = self._settings.step_m
        approach = -T_object_palm[:3, 2]
        up = approach if self._lift_direction is None else self._lift_direction
        back = self._flanges(straight_line(T_object_palm, self._retreat * approach, step))
        lift = self._flanges(straight_line(T_object_palm, self._settings.lift_m * up, step))
        if not self.inverse.within_ball(back).all():
            return Cause.ARM_REACH, None
        cause = Cause.ARM_REACH
        for number in self._best_first(back[:1]):
            how, ways = self._ways(back, lift, number)
            cause = _later(cause, how)
            for score, way_back, way_up in ways:
                if self._meets(way_back, way_up, postures):
                    cause = Cause.ARM_COLLISION
                    continue
                share = min(score / self._largest, 1.0)
                return None, ArmMotion(
                    self.arm.name,
                    self.arm.chain.joint_names,
                    way_back[::-1].copy(),
                    way_up,
                    share,
                    self._settings.manipulability_weight * share,
                )
        return cause, None

    def _best_first(self, first: Array) -> list[int]:
        """The slices of the redundant joint, by the largest manipulability at the grasp."""
        slices = range(len(self.inverse.slices))
        if len(slices) == 1:
            return [0]
        best = []
        for number in slices:
            [found] = self.inverse.solutions(first, number)
            starts = self.inverse.within_limits(found)
            score = manipulability(self.inverse.chain, starts).max() if len(starts) else -1.0
            best.append(float(score))
        return sorted(slices, key=lambda number: -best[number])

    def _meets(self, way_back: Array, way_up: Array, postures: tuple[Array, Array]) -> bool:
        """Whether the arm comes too near to anything on the approach or the lift."""
        opened, closed = postures
        return (
            self._collision.first_contact(way_back, opened, part=True) is not None
            or self._collision.first_contact(way_up, closed, part=False) is not None
        )

    def _ways(
        self, back: Array, lift: Array, number: int
    ) -> tuple[Cause, list[tuple[float, Array, Array]]]:
        """Ways back and up from the grasp in one slice, best manipulability first; how far they go.

        Those that are there are within the limits; `cause` says what the last of the others met.
        """
        [first] = self.inverse.solutions(back[:1], number)
        if not len(first):
            return Cause.ARM_REACH, []
        starts = self.inverse.within_limits(first)
        if not len(starts):
            return Cause.ARM_LIMITS, []
        deviation = self._settings.deviation_m
        found = self.inverse.solutions(back, number)
        rows, ways_back = follow(self.inverse, starts, back, found, deviation)
        kept = np.isfinite(self.inverse.turned(ways_back)).all(axis=(1, 2))
        rows, ways_back = rows[kept], ways_back[kept]
        if not len(rows):
            return Cause.ARM_APPROACH, []
        found = self.inverse.solutions(lift, number)
        lifted, ways_up = follow(self.inverse, starts[rows], lift, found, deviation)
        # turned as one, so that the lift begins where the approach ends
        both = self.inverse.turned(np.concatenate([ways_back[lifted], ways_up], axis=1))
        both = both[np.isfinite(both).all(axis=(1, 2))]
        score = manipulability(self.inverse.chain, both[:, 0])
        return Cause.ARM_LIFT, [
            (float(score[k]), both[k, : len(back)], both[k, len(back) :])
            for k in np.argsort(-score, kind="stable")
        ]

    def _flanges(self, T_object_palm: Array) -> Array:
        """Flanges (B, 4, 4) in the base of palms (B, 4, 4) in the object's frame."""
        return np.ascontiguousarray(self._T_base_object @ T_object_palm @ self._T_palm_flange)


def _later(one: Cause, other: Cause) -> Cause:
    return max(one, other, key=_PROGRESS.index)
