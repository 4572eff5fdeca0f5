"""What a physics engine has to do for trials: one protocol, and the door by which engines come.

An engine knows one part and one hand. The world's frame is the palm; neither it nor the pre-shape
moves. How a hand closes, when a part is let go and what counts as held is decided above it
(:mod:`~gpis_grasp_planner.verification.trial_world`,
:mod:`~gpis_grasp_planner.verification.protocol`), the same for every engine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.verification.settings import VerificationSettings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Contact:
    """One contact of the running simulation: the hand's link, depth [m] and normal force [N]."""

    link: int
    depth_m: float
    force_n: float


class Engine(Protocol):
    """A part and a hand under an engine's dynamics; a context manager.

    Attributes
    ----------
    step_s : float
        Length of a time step.
    n_pieces : int
        Convex pieces of the part that the engine has; the part has no surface elsewhere.
    """

    step_s: float
    n_pieces: int

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

    def use(self, settings: VerificationSettings) -> None:
        """Take another friction and mass from the next :meth:`place` on."""

    def take_pieces(self, pieces: Sequence[Array]) -> None:
        """Make the part anew of convex pieces (n, 3) [m] in its frame; before :meth:`place`."""

    def place(self, T_palm_part: Array, joints: Array) -> None:
        """Put the part at a pose and the hand at joint angles (J,) [rad], all at rest."""

    def lay_on(self, T_palm_plane: Array | None, friction: float) -> None:
        """Put a plane that only the part meets under it, z away from the plane; None: take it away.

        After :meth:`place`, and until the next one. `friction` is that of the pair.
        """

    def carry(self, mass_kg: float, damped: bool) -> None:
        """Give the part a mass, and a support that lets it move slowly, or none."""

    def halt(self) -> None:
        """Take the part's velocity from it."""

    def step(self, steps: int, force: Array | None) -> None:
        """Let time steps pass with a force (3,) [N] at the part's centre of mass, in P."""

    def joint_states(self, joints: Sequence[int]) -> Sequence[tuple[float, float]]:
        """Angle [rad] and speed [rad/s] of some of the hand's joints; [m, m/s] of sliding ones."""

    def motor(self, joint: int, speed: float, torque: float) -> None:
        """Let a motor go at a speed [rad/s, m/s] with a torque or force [N m, N] at most."""

    def press_of(self, link: int) -> float:
        """Sum of the normal forces [N] between the part and a link after the last step."""

    def contacts(self) -> list[Contact]:
        """What touches the part after the last step."""

    def part_pose(self) -> Array:
        """T_palm_part, (4, 4)."""

    def save(self) -> Any:
        """Keep the present state for :meth:`restore`."""

    def restore(self, state: Any) -> None:
        """Go back to a kept state; the motors are set anew by who drives them."""

    def forget(self, state: Any) -> None:
        """Free a kept state."""
