"""A finger's drive in physics: closing rows, breakaway, stops, gears that cannot be driven back.

The motor closes the joints by the rows of the closing table: one leads, those outwards of it follow
with their ratios. Where a link meets the object that is not the outermost, it is freed at the
breakaway torque (the Barrett's TorqueSwitch): its joint and those before it are held by their
gears, and the next row goes on, until the outermost link presses with the full tip force. Where a
link outwards of all that could be held meets the object first, the finger presses as one, with the
same force at the tip. A joint at its stop is held as well, if the hand advances at stops. A joint
that is pushed back resists with the holding force; if its gears lock themselves it stands where it
was, else the motor presses back.

A finger of one link has one row only. The jaws of a coupled hand close each by
itself, and the hand is placed so that both arrive at once; what one motor does to a part that lies
aside, it pushes it, is not in a trial. When both press, the mechanism between them bears what
pushes both the same way: one jaw is held with the joint's effort, and the other presses against it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.finger import Finger
from gpis_grasp_planner.quality.closing_balance import tip_arms
from gpis_grasp_planner.verification.engine import Engine
from gpis_grasp_planner.verification.settings import VerificationSettings

_STALLED = 0.1
_STALL_TIME_S = 1.0 / 50.0
_COUPLING_GAIN = 20.0
_BACK_DRIVEN_RAD = 1e-3
_AT_STOP_RAD = 1e-3


class Phase(IntEnum):
    """Where a finger's drive is; from PRESSING on, the finger is closed."""

    CLOSING = 0
    CURLING = 1  # a link is held after breakaway, the outermost goes on
    PRESSING = 2  # pressing with the tip force
    ENDED = 3  # at a joint's end: the gears hold


@dataclass(frozen=True)
class _State:
    phase: Phase = Phase.CLOSING
    row: int = 0  # of the closing table; the joints before it are held
    base: tuple[float, ...] = ()  # of the followers, where the leading joint is at 0
    held: tuple[float, ...] = ()  # where the joints before the row are, and of an ended finger all
    driven_back: bool = False
    stalled_s: float = 0.0
    furthest: float = 0.0


class FingerDrive:
    """Sets the motors of one finger's joints, a state machine over time."""

    def __init__(
        self,
        engine: Engine,
        hand: HandDescription,
        finger: Finger,
        settings: VerificationSettings,
    ):
        self.engine, self.finger, self._drive = engine, finger, hand.drive
        self._joints = list(finger.joints)
        self._n = len(self._joints)
        number = hand.fingers.index(finger)
        self.unit = float(hand.closing_unit[number])
        self.speed = settings.closing_speed_rad_s * self.unit
        self._upper = hand.joint_upper[self._joints]
        press, hold = settings.forces_n(hand.drive)
        arms = tip_arms(hand, number)
        self.tip_torque = [press * arm for arm in arms]
        self.hold_torque = [hold * arm for arm in arms]
        effort = [float(hand.joint_effort[joint]) for joint in self._joints]
        if hand.drive.independent:
            self.tip_torque = [min(pair) for pair in zip(self.tip_torque, effort, strict=True)]
        # A finger of one link has nothing to free, and closes with what it presses with.
        freed_at = hand.drive.breakaway_torque if self._n > 1 else self.tip_torque[0]
        # Each joint's own motor, or the mechanism between the jaws, holds in place of the finger's.
        if hand.drive.coupled or hand.drive.independent:
            self.hold_torque = effort
        self.breakaway_torque = [min(freed_at, torque) for torque in self.tip_torque]
        self._state = _State(base=(0.0,) * self._n)

    @property
    def phase(self) -> Phase:
        """Where the drive is."""
        return self._state.phase

    @property
    def inner_links(self) -> tuple[int, ...]:
        """Links that would be held if they touched now; none once the finger presses."""
        state = self._state
        if state.phase >= Phase.PRESSING:
            return ()
        return self.finger.links[state.row : -1]

    def start(self) -> None:
        """Begin to close, by the first row whose joint is not at its stop."""
        while self._stops_at(self._angles()):
            self._go_on(self._state.row + 1, self._angles())
        self._close()

    def snapshot(self) -> _State:
        """The drive's state, to come back to with :meth:`restore`."""
        return self._state

    def restore(self, snapshot: _State) -> None:
        """Take up a state and set the motors accordingly."""
        self._state = snapshot
        if self.phase is Phase.ENDED:
            self._end()
        elif self.phase is Phase.PRESSING:
            self._press()

    def update(self, elapsed_s: float, touching: Collection[int]) -> None:
        """Look at the joints after some time and go on to the next phase where it is due.

        `touching` are those of the :attr:`inner_links` that touch the part.
        """
        states = self.engine.joint_states(self._joints)
        state = self._state
        angles = [angle for angle, _ in states]
        if self._drive.self_locking:
            self._stand(angles)
        if state.phase is Phase.ENDED:
            return
        self._follow(angles)
        position, speed = states[state.row]
        stalled = state.stalled_s + elapsed_s if speed < _STALLED * self.speed else 0.0
        self._state = state = replace(state, stalled_s=stalled)
        if self._stops_at(angles):
            self._go_on(state.row + 1, angles)
            self._close()
        elif position >= self._upper[state.row]:
            self._state = replace(state, phase=Phase.ENDED, held=tuple(angles))
            self._end()
        elif state.phase is Phase.PRESSING:
            furthest = max(state.furthest, position)
            driven_back = position < furthest - _BACK_DRIVEN_RAD * self.unit
            self._state = replace(state, furthest=furthest, driven_back=driven_back)
            if driven_back != state.driven_back:
                self._press()
        elif stalled >= _STALL_TIME_S:
            self._state = replace(state, stalled_s=0.0)
            inner = [k for k in range(state.row, self._n - 1) if self.finger.links[k] in touching]
            if inner:
                self._go_on(inner[0] + 1, angles)
                self._close()
            else:
                self._state = replace(self._state, phase=Phase.PRESSING, furthest=position)
                self._press()

    def hold(self) -> None:
        """Stay where it is, whatever it is pushed with up to its holding force."""
        self._state = replace(self._state, phase=Phase.ENDED, held=tuple(self._angles()))
        self._end()

    def _angles(self) -> list[float]:
        return [angle for angle, _ in self.engine.joint_states(self._joints)]

    def _stops_at(self, angles: Sequence[float]) -> bool:
        """Whether the leading joint is held by its stop and others go on."""
        row = self._state.row
        goes_on = self._drive.advances_at_stop and row < self._n - 1
        return bool(goes_on and angles[row] >= self._upper[row] - _AT_STOP_RAD)

    def _go_on(self, row: int, angles: Sequence[float]) -> None:
        """Hold the joints before a row, which moves from where the finger is."""
        ratio = self.finger.closing_ratio[row]
        base = tuple(float(q - r * angles[row]) for q, r in zip(angles, ratio, strict=True))
        phase = Phase.CURLING if row == self._n - 1 else Phase.CLOSING
        held = self._state.held + tuple(angles[len(self._state.held) : row])
        self._state = _State(phase=phase, row=row, base=base, held=held)

    def _close(self) -> None:
        """Move by the present row: with the torque that frees a link, the last row with the tip's.

        Followers of the first row start without a correction of their place.
        """
        row = self._state.row
        last = row == self._n - 1 and self._n > 1
        self._lead(self.tip_torque[row] if last else self.breakaway_torque[row], self._speed())
        for k in range(row + 1, self._n):
            speed = self._speed() * float(self.finger.closing_ratio[row, k])
            self.engine.motor(self._joints[k], speed, self.hold_torque[k])

    def _speed(self) -> float:
        """Of the leading joint: the motor's is the same in all rows [rad/s]."""
        travel = self.finger.closing_ratio.sum(axis=1)
        return self.speed * float(travel[0] / travel[self._state.row])

    def _lead(self, torque: float, speed: float) -> None:
        """Hold the joints before the row and move its first."""
        row = self._state.row
        for k in range(row):
            self.engine.motor(self._joints[k], 0.0, self.hold_torque[k])
        self.engine.motor(self._joints[row], speed, torque)

    def _follow(self, angles: Sequence[float]) -> None:
        """Keep the joints outwards of the leading one to their ratios."""
        state = self._state
        for k in range(state.row + 1, self._n):
            ratio = float(self.finger.closing_ratio[state.row, k])
            speed = self._speed() if state.phase is Phase.CLOSING else 0.0
            wanted = state.base[k] + ratio * angles[state.row]
            self.engine.motor(
                self._joints[k],
                ratio * speed + _COUPLING_GAIN * (wanted - angles[k]),
                self.hold_torque[k],
            )

    def _stand(self, angles: Sequence[float]) -> None:
        """Bring joints with gears that lock themselves back to where they were held."""
        state = self._state
        wanted = dict(enumerate(state.held))
        if state.driven_back:
            wanted[state.row] = state.furthest
        for k, angle in wanted.items():
            speed = _COUPLING_GAIN * (angle - angles[k])
            self.engine.motor(self._joints[k], speed, self.hold_torque[k])

    def _press(self) -> None:
        torque = self.hold_torque if self._state.driven_back else self.tip_torque
        stands = self._drive.self_locking and self._state.driven_back
        self._lead(torque[self._state.row], 0.0 if stands else self._speed())

    def _end(self) -> None:
        for joint, torque in zip(self._joints, self.hold_torque, strict=True):
            self.engine.motor(joint, 0.0, torque)
