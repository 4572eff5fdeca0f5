"""Bullet as an engine of trials."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.transforms import (
    from_position_quat_xyzw,
    inverse,
    to_position_quat_xyzw,
    transform,
)
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.scene.bullet_world import bullet_client
from gpis_grasp_planner.verification.bullet.bodies import (
    HandBodies,
    add_hand,
    add_object,
    link_hulls,
    set_mass,
)
from gpis_grasp_planner.verification.engine import Contact
from gpis_grasp_planner.verification.inertia import inertia_of
from gpis_grasp_planner.verification.settings import VerificationSettings

Array = NDArray[np.float64]

_SOLVED_KG = 0.1  # mass for which the settings' number of iterations is
_SUPPORT_DAMPING = 50.0
# Share of a sticking contact's drift that the friction anchor takes back in a step. Without the
# anchor, parts creep through the fingers by what the iterations leave unsolved.
_FRICTION_ERP = 0.8
# Bullet looks for contacts this far ahead; its default of 20 mm costs, and no link moves by more
# than a fifth of this in a step.
_CONTACT_RANGE_M = 1e-3


def iterations(settings: VerificationSettings) -> int:
    """Iterations of the contact solver: more for lighter parts, by the root of the mass.

    The solver goes from contact to contact, and what a finger of 0.1 kg presses with takes the more
    rounds to arrive on the other side the lighter the part between them is. With the same 50 for
    5 g as for 0.1 kg, links sink in by 2 mm.
    """
    lightness = max(1.0, _SOLVED_KG / settings.mass_kg)
    return round(settings.solver_iterations * lightness**0.5)


class BulletEngine:
    """A part and a hand under Bullet's dynamics, an :class:`~..engine.Engine`.

    Parameters
    ----------
    hand : HandDescription
    part : Part
    settings : VerificationSettings
    """

    def __init__(self, hand: HandDescription, part: Part, settings: VerificationSettings):
        self.hand, self.part, self.settings = hand, part, settings
        self.n_pieces = 0
        self.step_s = 1.0 / settings.rate_hz
        self._object = self._plane = -1
        self._hulls = link_hulls(hand)
        self._moments, axes = inertia_of(part)
        self._T_part_body = transform(axes, part.center_of_mass)
        self._bodies: HandBodies | None = None

    def __enter__(self) -> Self:
        self._context = bullet_client()
        self.client = self._context.__enter__()
        self.client.setPhysicsEngineParameter(
            fixedTimeStep=self.step_s,
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

    def use(self, settings: VerificationSettings) -> None:
        """Take another friction and mass from the next :meth:`place` on."""
        self.settings = settings
        if self._object >= 0:
            self._surface(self._object, -1, settings.friction)
        self.client.setPhysicsEngineParameter(numSolverIterations=iterations(settings))

    def take_pieces(self, pieces: Sequence[Array]) -> None:
        """Make the part anew of convex pieces (n, 3) in its frame. Some 0.3 ms a piece."""
        if self._object >= 0:
            self.client.removeBody(self._object)
        self._object = add_object(self.client, pieces, self.part, self.settings.mass_kg, np.eye(4))
        self.n_pieces = len(pieces)
        self._surface(self._object, -1, self.settings.friction)

    def place(self, T_palm_part: Array, joints: Array) -> None:
        """Put the part at a pose and the hand at joint angles (J,) [rad], all at rest."""
        client = self.client
        self.lay_on(None, 0.0)
        if self._bodies is not None:
            for body in {body for body, _ in self._bodies.link_of}:
                client.removeBody(body)
        bodies = self._bodies = add_hand(client, self.hand, self._hulls, joints)
        self._bullet_link = {link: key for key, link in bodies.link_of.items()}
        for joint, index in bodies.joint_of.items():
            client.resetJointState(bodies.fingers, index, float(joints[joint]))
        # Bullet multiplies both friction coefficients of a pair.
        shares = self.settings.link_friction_shares(self.hand)
        for (body, index), link in bodies.link_of.items():
            self._surface(body, index, shares[link])
        position, quat_xyzw = to_position_quat_xyzw(T_palm_part @ self._T_part_body)
        client.resetBasePositionAndOrientation(self._object, position, quat_xyzw)
        self.halt()

    def lay_on(self, T_palm_plane: Array | None, friction: float) -> None:
        """Put a plane under the part's pieces, z away from it; None: take it away."""
        client = self.client
        if self._plane >= 0:
            client.removeBody(self._plane)
            self._plane = -1
        if T_palm_plane is None:
            return
        assert self._bodies is not None
        position, quat_xyzw = to_position_quat_xyzw(T_palm_plane)
        shape = client.createCollisionShape(client.GEOM_PLANE, planeNormal=[0.0, 0.0, 1.0])
        self._plane = int(
            client.createMultiBody(
                baseMass=0.0,
                baseCollisionShapeIndex=shape,
                basePosition=position,
                baseOrientation=quat_xyzw,
            )
        )
        for body, link in self._bodies.link_of:
            client.setCollisionFilterPair(self._plane, body, -1, link, 0)
        self._surface(self._plane, -1, friction / max(self.settings.friction, 1e-6))

    def carry(self, mass_kg: float, damped: bool) -> None:
        """Give the part a mass, and a support that lets it move slowly, or none."""
        set_mass(self.client, self._object, mass_kg, self._moments)
        rate = _SUPPORT_DAMPING if damped else 0.0
        self.client.changeDynamics(self._object, -1, linearDamping=rate, angularDamping=rate)

    def halt(self) -> None:
        """Take the part's velocity from it."""
        self.client.resetBaseVelocity(self._object, [0.0] * 3, [0.0] * 3)

    def step(self, steps: int, force: Array | None) -> None:
        """Let time steps pass with a force (3,) [N] at the part's centre of mass, in P."""
        client = self.client
        for _ in range(steps):
            if force is not None:
                at = client.getBasePositionAndOrientation(self._object)[0]
                client.applyExternalForce(self._object, -1, force, at, client.WORLD_FRAME)
            client.stepSimulation()

    def joint_states(self, joints: Sequence[int]) -> Sequence[tuple[float, float]]:
        """Angle [rad] and speed [rad/s] of some of the hand's joints."""
        assert self._bodies is not None
        indices = [self._bodies.joint_of[joint] for joint in joints]
        found = self.client.getJointStates(self._bodies.fingers, indices)
        return [(state[0], state[1]) for state in found]

    def motor(self, joint: int, speed: float, torque: float) -> None:
        """Let a joint's motor go at a speed [rad/s] with a torque [N m] at most."""
        assert self._bodies is not None
        self.client.setJointMotorControl2(
            self._bodies.fingers,
            self._bodies.joint_of[joint],
            self.client.VELOCITY_CONTROL,
            targetVelocity=speed,
            force=torque,
        )

    def press_of(self, link: int) -> float:
        """Sum of the normal forces [N] between the part and a link; near points have none."""
        body, index = self._bullet_link[link]
        found = self.client.getContactPoints(self._object, body, -1, index)
        return float(sum(row[9] for row in found))

    def contacts(self) -> list[Contact]:
        """What touches the part after the last step."""
        assert self._bodies is not None
        found = self.client.getContactPoints(bodyA=self._object)
        return [
            Contact(self._bodies.link_of[row[2], row[4]], -float(row[8]), float(row[9]))
            for row in found
            if row[2] != self._plane
        ]

    def part_pose(self) -> Array:
        """T_palm_part, (4, 4)."""
        T = from_position_quat_xyzw(*self.client.getBasePositionAndOrientation(self._object))
        return T @ inverse(self._T_part_body)

    def save(self) -> Any:
        """Keep the present state for :meth:`restore`: positions, velocities, contacts."""
        return self.client.saveState()

    def restore(self, state: Any) -> None:
        """Go back to a kept state; the motors are set anew by who drives them."""
        self.client.restoreState(stateId=state)

    def forget(self, state: Any) -> None:
        """Free a kept state."""
        self.client.removeState(state)

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
