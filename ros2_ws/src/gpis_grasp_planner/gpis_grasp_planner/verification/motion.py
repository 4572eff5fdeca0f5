"""How far a part went in the hand, and when the rest of a push is known.

A part that is held comes to rest a tenth of a second after a push began; most of the two seconds
would show a part at rest. So a push is watched in windows, and ends once what the part drifts in a
window, taken twice and for all the time that is left, is a small share of the limits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpis_grasp_planner.planning.verification_settings import VerificationSettings

_WINDOW_S = 0.05
_EARLIEST_END_S = 0.1
_STILL_SHARE = 0.1
_CAUTION = 2.0


@dataclass(frozen=True)
class Motion:
    """How far the object went relative to the palm."""

    slip_m: float
    rotation_rad: float

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
        self._last = NO_MOTION
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
        largest = Motion(
            max(self.largest.slip_m, now.slip_m), max(self.largest.rotation_rad, now.rotation_rad)
        )
        left_s = self._settings.duration_s - self.elapsed_s
        windows = _CAUTION * left_s / step_s
        ahead = Motion(
            windows * abs(now.slip_m - self._last.slip_m),
            windows * abs(now.rotation_rad - self._last.rotation_rad),
        )
        self.largest, self._last = largest, now
        self.held = now.within(self._settings)
        if not self.held or left_s < 1e-9:
            self.over = True
        elif self.elapsed_s >= _EARLIEST_END_S and ahead.within(self._settings, _STILL_SHARE):
            expected = Motion(
                largest.slip_m + ahead.slip_m, largest.rotation_rad + ahead.rotation_rad
            )
            if expected.within(self._settings):
                self.largest, self.over = expected, True
