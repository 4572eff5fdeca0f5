"""Bullet's world of one part, in which one grasp after the other is tried.

The world's frame is the palm. The part is held in its place while the fingers close from the
pre-grasp, as its support holds it, and is let go when every finger presses; what the closing
fingers do to a part without any support (they kick a light one away) is no property of a grasp.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.transforms import (
    from_position_quat_xyzw,
    inverse,
    rotation_angle,
    to_position_quat_xyzw,
    transform,
)
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.scene.bullet_world import bullet_client
from gpis_grasp_planner.verification.bullet.bodies import (
    HandBodies,
    add_hand,
    add_object,
    inertia_of,
    link_hulls,
    set_mass,
)
from gpis_grasp_planner.verification.bullet.drive import FingerDrive, Phase
from gpis_grasp_planner.verification.motion import Motion
from gpis_grasp_planner.verification.settings import VerificationSettings

Array = NDArray[np.float64]

_CONTROL_S = 1.0 / 120.0
_FIXTURE_KG = 1e4
_TOUCH_N = 0.1
_SUPPORTED_KG = 5.0
_SOLVED_KG = 0.1  # mass for which the settings' number of iterations is
_SUPPORT_DAMPING = 50.0
# Share of a sticking contact's drift that the friction anchor takes back in a step. Without the
# anchor, parts creep through the fingers by what the iterations leave unsolved.
_FRICTION_ERP = 0.8
# Bullet looks for contacts this far ahead; its default of 20 mm costs, and no link moves by more
# than a fifth of this in a step.
_CONTACT_RANGE_M = 1e-3


@dataclass(frozen=True)
class Contact:
    """One contact of the running simulation: the hand's link, depth [m] and normal force [N]."""

    link: int
    depth_m: float
    force_n: float


def iterations(settings: VerificationSettings) -> int:
    """Iterations of the contact solver: more for lighter parts, by the root of the mass.

    The solver goes from contact to contact, and what a finger of 0.1 kg presses with takes the more
    rounds to arrive on the other side the lighter the part between them is. With the same 50 for
    5 g as for 0.1 kg, links sink in by 2 mm.
    """
    lightness = max(1.0, _SOLVED_KG / settings.mass_kg)
    return round(settings.solver_iterations * lightness**0.5)


class TrialWorld:
    """A part and a hand under Bullet's dynamics; a context manager.

    Parameters
    ----------
    hand : HandDescription
    part : Part
    settings : VerificationSettings

    Attributes
    ----------
    n_pieces : int
        Convex pieces of the part that the world has; the part has no surface elsewhere.
    """

    def __init__(
        self,
        hand: HandDescription,
        part: Part,
        settings: VerificationSettings,
    ):
        self.hand, self.part, self.settings = hand, part, settings
        self.n_pieces = 0
        self._object = -1
        self._hulls = link_hulls(hand)
        self._moments, axes = inertia_of(part)
        self._T_part_body = transform(axes, part.center_of_mass)
        self._bodies: HandBodies | None = None
        self.drives: list[FingerDrive] = []

    def __enter__(self) -> Self:
        self._context = bullet_client()
        self.client = self._context.__enter__()
        self._step_s = 1.0 / self.settings.rate_hz
        self.client.setPhysicsEngineParameter(
            fixedTimeStep=self._step_s,
            numSolverIterations=iterations(self.settings),
            enableConeFriction=1,
            frictionERP=_FRICTION_ERP,
            contactBreakingThreshold=_CONTACT_RANGE_M,
            enableFileCaching=0,
            deterministicOverlappingPairs=1,
        )
        self.client.setGravity(0.0, 0.0, 0.0)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._context.__exit__(kind, value, trace)

    def take_pieces(self, pieces: Sequence[Array]) -> None:
        """Make the part anew of convex pieces (n, 3) of its surface, in the part's frame.

        Some 0.3 ms a piece. To be called before :meth:`place`.
        """
        if self._object >= 0:
            self.client.removeBody(self._object)
        self._object = add_object(self.client, pieces, self.part, self.settings.mass_kg, np.eye(4))
        self.n_pieces = len(pieces)
        self._surface(self._object, -1, self.settings.friction)

    def place(self, T_object_palm: Array, start_joints: Array) -> None:
        """Set up a grasp: the part held in its place, the hand at joint angles (J,) [rad]."""
        client = self.client
        if self._bodies is not None:
            for body in {body for body, _ in self._bodies.link_of}:
                client.removeBody(body)
        bodies = self._bodies = add_hand(client, self.hand, self._hulls, start_joints)
        for joint, index in bodies.joint_of.items():
            client.resetJointState(bodies.fingers, index, float(start_joints[joint]))
        for body, link in bodies.link_of:
            self._surface(body, link, 1.0)
        position, quat_xyzw = to_position_quat_xyzw(inverse(T_object_palm) @ self._T_part_body)
        client.resetBasePositionAndOrientation(self._object, position, quat_xyzw)
        client.resetBaseVelocity(self._object, [0.0] * 3, [0.0] * 3)
        set_mass(client, self._object, _FIXTURE_KG, self._moments)
        self._damp(_SUPPORT_DAMPING)
        self.drives = [
            FingerDrive(client, self.hand, finger, bodies, self.settings)
            for finger in self.hand.fingers
        ]

    def use(self, settings: VerificationSettings) -> None:
        """Take another friction and mass from the next :meth:`place` on."""
        self.settings = settings
        if self._object >= 0:
            self._surface(self._object, -1, settings.friction)
        self.client.setPhysicsEngineParameter(numSolverIterations=iterations(settings))

    def close(self) -> bool:
        """Close the fingers; returns whether all of them press or came to their end in time."""
        for drive in self.drives:
            drive.start()
        elapsed = 0.0
        while elapsed < self.settings.closing_time_s:
            if all(drive.phase >= Phase.PRESSING for drive in self.drives):
                return True
            elapsed += self.run(_CONTROL_S)
        return False

    def release(self) -> None:
        """Let go of the part: its support gives way slowly, then nothing holds it but the hand.

        At once it would be flung by fingers that had pressed against a fixed part, each for
        itself; heavy and damped it moves to where their forces balance.
        """
        client, body = self.client, self._object
        set_mass(client, body, _SUPPORTED_KG, self._moments)
        self.run(self.settings.settling_time_s)
        set_mass(client, body, self.settings.mass_kg, self._moments)
        self._damp(0.0)
        client.resetBaseVelocity(body, [0.0] * 3, [0.0] * 3)
        self.run(0.5 * self.settings.settling_time_s)

    def save(self) -> tuple[int, list[Any]]:
        """Keep the present state for :meth:`restore`."""
        return self.client.saveState(), [drive.snapshot() for drive in self.drives]

    def restore(self, saved: tuple[int, list[Any]]) -> None:
        """Go back to a kept state: positions, velocities, contacts and drives."""
        self.client.restoreState(stateId=saved[0])
        for drive, snapshot in zip(self.drives, saved[1], strict=True):
            drive.restore(snapshot)

    def forget(self, saved: tuple[int, list[Any]]) -> None:
        """Free a kept state."""
        self.client.removeState(saved[0])

    def run(self, duration_s: float, acceleration: Array | None = None) -> float:
        """Let time pass with an acceleration (3,) [m/s^2] of the part, in the palm's frame.

        Returns the time that passed: whole intervals of the drives' control.
        """
        client = self.client
        force = None if acceleration is None else acceleration * self.settings.mass_kg
        steps = max(1, round(_CONTROL_S / self._step_s))
        rounds = max(1, round(duration_s / (steps * self._step_s)))
        for _ in range(rounds):
            for _ in range(steps):
                if force is not None:
                    at = client.getBasePositionAndOrientation(self._object)[0]
                    client.applyExternalForce(self._object, -1, force, at, client.WORLD_FRAME)
                client.stepSimulation()
            touching = self._inner_links_touching()
            for drive in self.drives:
                drive.update(steps * self._step_s, drive.finger.inner_link in touching)
        return rounds * steps * self._step_s

    def part_pose(self) -> Array:
        """T_palm_part, (4, 4)."""
        T = from_position_quat_xyzw(*self.client.getBasePositionAndOrientation(self._object))
        return T @ inverse(self._T_part_body)

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
        assert self._bodies is not None
        found = self.client.getContactPoints(bodyA=self._object)
        return [
            Contact(self._bodies.link_of[row[2], row[4]], -float(row[8]), float(row[9]))
            for row in found
        ]

    def _inner_links_touching(self) -> set[int]:
        waiting = [drive for drive in self.drives if drive.phase is Phase.CLOSING]
        assert self._bodies is not None
        return {
            drive.finger.inner_link
            for drive in waiting
            if self._press_of(self._bodies.fingers, drive.inner) > _TOUCH_N
        }

    def _press_of(self, body: int, link: int) -> float:
        """Sum of the normal forces [N] between the part and a link; near points have none."""
        found = self.client.getContactPoints(self._object, body, -1, link)
        return float(sum(row[9] for row in found))

    def _damp(self, rate: float) -> None:
        self.client.changeDynamics(self._object, -1, linearDamping=rate, angularDamping=rate)

    def _surface(self, body: int, link: int, friction: float) -> None:
        self.client.changeDynamics(
            body,
            link,
            lateralFriction=friction,
            rollingFriction=0.0,
            spinningFriction=0.0,
            restitution=0.0,
            frictionAnchor=1,
            linearDamping=0.0,
            angularDamping=0.0,
            jointDamping=0.0,
        )
