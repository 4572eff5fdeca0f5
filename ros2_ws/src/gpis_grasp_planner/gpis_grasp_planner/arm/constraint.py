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
        Its world is the arm's.
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
        T_base_world = inverse(arm.T_world_base)
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
        cause, ways = self._ways(back, lift)
        for score, way_back, way_up in sorted(ways, key=lambda way: -way[0]):
            posture_open, posture_closed = postures
            if self._collision.first_contact(way_back, (posture_open,), part=True) is not None:
                cause = Cause.ARM_COLLISION
                continue
            if self._collision.first_contact(way_up, (posture_closed,), part=False) is not None:
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

    def _ways(self, back: Array, lift: Array) -> tuple[Cause, list[tuple[float, Array, Array]]]:
        """All ways back and up from the grasp, each with its manipulability; the last obstacle."""
        cause, ways = Cause.ARM_REACH, []
        line = np.concatenate([back, lift[1:]])
        deviation = self._settings.deviation_m
        for number in range(len(self.inverse.slices)):
            [first] = self.inverse.solutions(back[:1], number)
            if not len(first):
                continue
            cause = _later(cause, Cause.ARM_LIMITS)
            starts = self.inverse.within_limits(first)
            if not len(starts):
                continue
            cause = _later(cause, Cause.ARM_APPROACH)
            found = [first, *self.inverse.solutions(line[1:], number)]
            found_up = [first, *found[len(back) :]]
            score = manipulability(self.inverse.chain, starts)
            for start, value in zip(starts, score, strict=True):
                way_back = follow(self.inverse, start, back, found[: len(back)], deviation)
                if way_back is None or not np.isfinite(self.inverse.turned(way_back[None])).all():
                    continue
                cause = _later(cause, Cause.ARM_LIFT)
                way_up = follow(self.inverse, start, lift, found_up, deviation)
                if way_up is None:
                    continue
                # turned as one, so that the lift begins where the approach ends
                both = self.inverse.turned(np.concatenate([way_back, way_up])[None])[0]
                if np.isfinite(both).all():
                    ways.append((float(value), both[: len(back)], both[len(back) :]))
        return cause, ways

    def _flanges(self, T_object_palm: Array) -> Array:
        """Flanges (B, 4, 4) in the base of palms (B, 4, 4) in the object's frame."""
        return np.ascontiguousarray(self._T_base_object @ T_object_palm @ self._T_palm_flange)


def _later(one: Cause, other: Cause) -> Cause:
    return max(one, other, key=_PROGRESS.index)
