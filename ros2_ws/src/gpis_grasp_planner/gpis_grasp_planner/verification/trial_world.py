"""One grasp after the other under an engine's dynamics: closing, letting go, pushing.

The world's frame is the palm. The part is held in its place while the fingers close from the
pre-grasp, as its support holds it, and is let go when every finger presses; what the closing
fingers do to a part without any support (they kick a light one away) is no property of a grasp.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.transforms import inverse, rotation_angle
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.verification.engine import Contact, Engine
from gpis_grasp_planner.verification.finger_drive import FingerDrive, Phase
from gpis_grasp_planner.verification.motion import Motion
from gpis_grasp_planner.verification.settings import VerificationSettings

Array = NDArray[np.float64]

_CONTROL_S = 1.0 / 120.0
_FIXTURE_KG = 1e4
_TOUCH_N = 0.1
_SUPPORTED_KG = 5.0


class TrialWorld:
    """A part and a hand whose fingers are driven; a context manager.

    Parameters
    ----------
    name : str
        The engine's, by which verdicts name it.
    engine : Engine
        Of the same hand, part and settings.
    hand : HandDescription
    part : Part
    settings : VerificationSettings
    """

    def __init__(
        self,
        name: str,
        engine: Engine,
        hand: HandDescription,
        part: Part,
        settings: VerificationSettings,
    ):
        self.name = name
        self.engine, self.hand, self.part, self.settings = engine, hand, part, settings
        self.drives: list[FingerDrive] = []

    def __enter__(self) -> Self:
        self.engine.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.engine.__exit__(kind, value, trace)

    @property
    def n_pieces(self) -> int:
        """Convex pieces of the part that the engine has."""
        return self.engine.n_pieces

    def take_pieces(self, pieces: Sequence[Array]) -> None:
        """Make the part anew of convex pieces; see :meth:`.engine.Engine.take_pieces`."""
        self.engine.take_pieces(pieces)

    def use(self, settings: VerificationSettings) -> None:
        """Take another friction and mass from the next :meth:`place` on."""
        self.settings = settings
        self.engine.use(settings)

    def place(self, T_object_palm: Array, start_joints: Array) -> None:
        """Set up a grasp: the part held in its place, the hand at joint angles (J,) [rad]."""
        self.engine.place(inverse(T_object_palm), start_joints)
        self.engine.carry(_FIXTURE_KG, damped=True)
        self.drives = [
            FingerDrive(self.engine, self.hand, finger, self.settings)
            for finger in self.hand.fingers
        ]

    def lay_down(self, T_palm_plane: Array, friction: float) -> None:
        """Let the part lie free on a plane, z away from it, in place of being held."""
        self.engine.carry(self.settings.mass_kg, damped=False)
        self.engine.lay_on(T_palm_plane, friction)

    def close(
        self, acceleration: Array | None = None, watch: Callable[[], None] = lambda: None
    ) -> bool:
        """Close the fingers; returns whether all of them press or came to their end in time.

        Parameters
        ----------
        acceleration : (3,) array [m/s^2], optional
            Of the part meanwhile, as :meth:`run` takes it.
        watch : callable
            Called after each interval of the drives' control.
        """
        for drive in self.drives:
            drive.start()
        elapsed = 0.0
        while elapsed < self.settings.closing_time_s:
            if all(drive.phase >= Phase.PRESSING for drive in self.drives):
                return True
            elapsed += self.run(_CONTROL_S, acceleration)
            watch()
        return False

    def release(self) -> None:
        """Let go of the part: its support gives way slowly, then nothing holds it but the hand.

        At once it would be flung by fingers that had pressed against a fixed part, each for
        itself; heavy and damped it moves to where their forces balance.
        """
        self.engine.carry(_SUPPORTED_KG, damped=True)
        self.run(self.settings.settling_time_s)
        self.engine.carry(self.settings.mass_kg, damped=False)
        self.engine.halt()
        self.run(0.5 * self.settings.settling_time_s)

    def save(self) -> tuple[Any, list[Any]]:
        """Keep the present state for :meth:`restore`."""
        return self.engine.save(), [drive.snapshot() for drive in self.drives]

    def restore(self, saved: tuple[Any, list[Any]]) -> None:
        """Go back to a kept state: positions, velocities, contacts and drives."""
        self.engine.restore(saved[0])
        for drive, snapshot in zip(self.drives, saved[1], strict=True):
            drive.restore(snapshot)

    def forget(self, saved: tuple[Any, list[Any]]) -> None:
        """Free a kept state."""
        self.engine.forget(saved[0])

    def run(self, duration_s: float, acceleration: Array | None = None) -> float:
        """Let time pass with an acceleration (3,) [m/s^2] of the part, in the palm's frame.

        Returns the time that passed: whole intervals of the drives' control.
        """
        force = None if acceleration is None else acceleration * self.settings.mass_kg
        steps = max(1, round(_CONTROL_S / self.engine.step_s))
        interval_s = steps * self.engine.step_s
        rounds = max(1, round(duration_s / interval_s))
        for _ in range(rounds):
            self.engine.step(steps, force)
            touching = self._inner_links_touching()
            for drive in self.drives:
                drive.update(interval_s, touching)
            if self.hand.drive.coupled and all(d.phase is Phase.PRESSING for d in self.drives):
                self.drives[0].hold()
        return rounds * interval_s

    def part_pose(self) -> Array:
        """T_palm_part, (4, 4)."""
        return self.engine.part_pose()

    def motion_since(self, T_palm_part: Array) -> Motion:
        """How far the part's centre of mass went and how far the part turned since a pose."""
        now = self.part_pose()
        center = self.part.center_of_mass
        shift = (now[:3, :3] - T_palm_part[:3, :3]) @ center + now[:3, 3] - T_palm_part[:3, 3]
        return Motion(
            float(np.linalg.norm(shift)),
            float(rotation_angle(T_palm_part[:3, :3], now[:3, :3])),
        )

    def contacts(self) -> list[Contact]:
        """What touches the part after the last step."""
        return self.engine.contacts()

    def _inner_links_touching(self) -> set[int]:
        return {
            link
            for drive in self.drives
            for link in drive.inner_links
            if self.engine.press_of(link) > _TOUCH_N
        }
