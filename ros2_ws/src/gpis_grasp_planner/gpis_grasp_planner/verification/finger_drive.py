"""A finger's drive in physics: coupling, breakaway, and gears that cannot be driven back.

The motor closes both joints with q3 = q2 / 3. Where the inner link meets the object, the
TorqueSwitch frees it at the breakaway torque: the inner joint is held by its worm gear and the
distal link goes on by itself until it presses with the full tip force. Where the fingertip meets
the object first, the finger presses as one, with the same force at the tip. A joint that is
pushed back resists with the holding force.

A finger of one link has the first of these joints only. The jaws of a coupled hand close each by
itself, and the hand is placed so that both arrive at once; what one motor does to a part that lies
aside, it pushes it, is not in a trial. When both press, the mechanism between them bears what
pushes both the same way: one jaw is held with the joint's effort, and the other presses against it.
"""

from __future__ import annotations

from enum import IntEnum

from gpis_grasp_planner.hand.description import Finger, HandDescription
from gpis_grasp_planner.quality.closing_balance import tip_arms
from gpis_grasp_planner.verification.engine import Engine
from gpis_grasp_planner.verification.settings import VerificationSettings

_STALLED = 0.1
_STALL_TIME_S = 1.0 / 50.0
_COUPLING_GAIN = 20.0
_BACK_DRIVEN_RAD = 1e-3


class Phase(IntEnum):
    """Where a finger's drive is; from PRESSING on, the finger is closed."""

    CLOSING = 0
    CURLING = 1  # inner link held after breakaway, distal link goes on
    PRESSING = 2  # pressing with the tip force
    ENDED = 3  # at a joint's end: the gears hold


class FingerDrive:
    """Sets the motors of one finger's two joints, a state machine over time."""

    def __init__(
        self,
        engine: Engine,
        hand: HandDescription,
        finger: Finger,
        settings: VerificationSettings,
    ):
        self.engine, self.finger = engine, finger
        self.inner, self.distal = finger.inner_joint, finger.distal_joint
        self.two_links = len(finger.links) > 1
        self.ratio = hand.drive.distal_per_inner
        number = hand.fingers.index(finger)
        self.unit = float(hand.closing_unit[number])
        self.speed = settings.closing_speed_rad_s * self.unit
        self.inner_upper = float(hand.joint_upper[finger.inner_joint])
        self.distal_upper = float(hand.joint_upper[finger.distal_joint])
        inner_arm, distal_arm = tip_arms(hand, number)
        self.tip_torque = (settings.tip_force_n * inner_arm, settings.tip_force_n * distal_arm)
        self.hold_torque = (
            settings.holding_force_n * inner_arm,
            settings.holding_force_n * distal_arm,
        )
        # A finger of one link has nothing to free, and closes with what it presses with.
        freed_at = hand.drive.breakaway_torque if self.two_links else self.tip_torque[0]
        if hand.drive.coupled:  # not the motor holds, but the mechanism between the jaws
            self.hold_torque = (float(hand.joint_effort[self.inner]),) * 2
        self.breakaway_torque = min(freed_at, self.tip_torque[0])
        self.phase = Phase.CLOSING
        self._coupled = True
        self._driven_back = False
        self._stalled_s = 0.0
        self._furthest = 0.0

    def start(self) -> None:
        """Begin to close."""
        self.engine.motor(self.inner, self.speed, self.breakaway_torque)
        if self.two_links:
            self.engine.motor(self.distal, self.speed * self.ratio, self.hold_torque[1])

    def snapshot(self) -> tuple[Phase, bool, bool, float, float]:
        """The drive's state, to come back to with :meth:`restore`."""
        return (self.phase, self._coupled, self._driven_back, self._stalled_s, self._furthest)

    def restore(self, snapshot: tuple[Phase, bool, bool, float, float]) -> None:
        """Take up a state and set the motors accordingly."""
        self.phase, self._coupled, self._driven_back, self._stalled_s, self._furthest = snapshot
        if self.phase is Phase.ENDED:
            self._end()
        elif self.phase is Phase.PRESSING:
            self._press()

    def update(self, elapsed_s: float, inner_touches: bool) -> None:
        """Look at the joints after some time and go on to the next phase where it is due."""
        (q2, v2), (q3, v3) = self.engine.joint_states([self.inner, self.distal])
        if self.phase is Phase.ENDED:
            return
        if self._coupled and self.two_links:
            follow = self.ratio * (self.speed if self.phase is Phase.CLOSING else 0.0)
            follow += _COUPLING_GAIN * (self.ratio * q2 - q3)
            self.engine.motor(self.distal, follow, self.hold_torque[1])
        moving = v2 if self._coupled else v3
        self._stalled_s = self._stalled_s + elapsed_s if moving < _STALLED * self.speed else 0.0
        position = q2 if self._coupled else q3
        if position >= (self.inner_upper if self._coupled else self.distal_upper):
            self.phase = Phase.ENDED
            self._end()
        elif self.phase is Phase.PRESSING:
            self._furthest = max(self._furthest, position)
            driven_back = position < self._furthest - _BACK_DRIVEN_RAD * self.unit
            if driven_back != self._driven_back:
                self._driven_back = driven_back
                self._press()
        elif self._stalled_s >= _STALL_TIME_S:
            self._stalled_s = 0.0
            if self.phase is Phase.CLOSING and inner_touches and self.two_links:
                self.phase = Phase.CURLING
                self._coupled = False
            else:
                self.phase = Phase.PRESSING
                self._furthest = position
            self._press()

    def hold(self) -> None:
        """Stay where it is, whatever it is pushed with up to its holding force."""
        self.phase = Phase.ENDED
        self._end()

    def _press(self) -> None:
        inner, distal = self.hold_torque if self._driven_back else self.tip_torque
        if self._coupled:
            self.engine.motor(self.inner, self.speed, inner)
        else:
            self.engine.motor(self.inner, 0.0, self.hold_torque[0])
            self.engine.motor(self.distal, self.speed * (1.0 + self.ratio), distal)

    def _end(self) -> None:
        self.engine.motor(self.inner, 0.0, self.hold_torque[0])
        if self.two_links:
            self.engine.motor(self.distal, 0.0, self.hold_torque[1])
