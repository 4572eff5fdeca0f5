"""How far a part went in the hand, and when the rest of a push is known.

A part that is held comes to rest a tenth of a second after a push began; most of the two seconds
would show a part at rest. So a push is watched in windows, and ends once the part has hardly moved
and what it drifts in a window, taken twice and for all the time that is left, does not change that.
A part that has come further before it rests may break away again: it has to rest for longer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpis_grasp_planner.verification.settings import VerificationSettings

_WINDOW_S = 0.05
_EARLIEST_END_S = 0.1
_STILL_SHARE = 0.1
_CAUTION = 2.0
_MOVED_REST_WINDOWS = 6


@dataclass(frozen=True)
class Motion:
    """How far the object went relative to the palm."""

    slip_m: float
    rotation_rad: float

    def larger(self, other: Motion) -> Motion:
        """The larger way and the larger turn of both."""
        return Motion(max(self.slip_m, other.slip_m), max(self.rotation_rad, other.rotation_rad))

    def within(self, settings: VerificationSettings, share: float = 1.0) -> bool:
        """Whether it is below (a share of) the protocol's limits; not if it is not finite."""
        return bool(
            self.slip_m < share * settings.slip_limit_m
            and self.rotation_rad < share * np.radians(settings.rotation_limit_deg)
        )


NO_MOTION = Motion(0.0, 0.0)


class PushWatch:
    """Follows a part during a push: to its end, to its loss, or until it is seen to stay.

    Ask for :attr:`next_s`, let that time pass, and tell :meth:`see`, until :attr:`over`.

    Attributes
    ----------
    largest : Motion
        The largest seen, and once the push has ended early the drift that is to be expected.
    elapsed_s : float
    over, held : bool
        Whether the push is over, and whether the part has stayed within the limits.
    """

    def __init__(self, settings: VerificationSettings):
        self._settings = settings
        self._seen = [NO_MOTION]
        self.largest = NO_MOTION
        self.elapsed_s = 0.0
        self.over, self.held = False, True

    @property
    def next_s(self) -> float:
        """Time [s] after which the part is to be looked at next."""
        return min(_WINDOW_S, self._settings.duration_s - self.elapsed_s)

    def see(self, step_s: float, now: Motion) -> None:
        """Take in the motion since the push began, `step_s` after the last look."""
        self.elapsed_s += step_s
        self.largest = self.largest.larger(now)
        self._seen.append(now)
        self.held = now.within(self._settings)
        left_s = self._settings.duration_s - self.elapsed_s
        if not self.held or left_s < 1e-9:
            self.over = True
        elif self.elapsed_s >= _EARLIEST_END_S:
            self._end_if_known(left_s / step_s)

    def _end_if_known(self, windows_left: float) -> None:
        """End the push if the part has hardly moved, or has moved and then rested for long."""
        for rest, share in ((1, _STILL_SHARE), (_MOVED_REST_WINDOWS, 1.0)):
            if len(self._seen) <= rest:
                continue
            slips = [motion.slip_m for motion in self._seen[-1 - rest :]]
            turns = [motion.rotation_rad for motion in self._seen[-1 - rest :]]
            windows = _CAUTION * windows_left / rest
            slip_m = windows * (max(slips) - min(slips))
            rotation_rad = windows * (max(turns) - min(turns))
            expected = Motion(
                self.largest.slip_m + slip_m, self.largest.rotation_rad + rotation_rad
            )
            still = Motion(slip_m, rotation_rad).within(self._settings, _STILL_SHARE)
            if still and expected.within(self._settings, share):
                self.largest, self.over = expected, True
                return
