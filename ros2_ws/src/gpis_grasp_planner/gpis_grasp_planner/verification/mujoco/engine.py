"""MuJoCo as an engine of trials."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Any, Self

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.transforms import (
    apply,
    from_position_quat_xyzw,
    inverse,
    to_position_quat_xyzw,
    transform,
)
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.verification.engine import Contact
from gpis_grasp_planner.verification.inertia import inertia_of
from gpis_grasp_planner.verification.mujoco.model import (
    FAR_BELOW,
    PART_BODY,
    PLANE_GEOM,
    build_model,
    link_body,
)
from gpis_grasp_planner.verification.settings import VerificationSettings

Array = NDArray[np.float64]

_SUPPORT_RATE = 100.0  # 1/s, at which a support takes a part's velocity
# What this class changes of a compiled model and its state.
_SET_IN_MODEL = (
    "body_pos", "body_quat", "body_mass", "body_inertia", "dof_damping", "dof_frictionloss",
    "actuator_forcerange",
)  # fmt: skip
_SET_IN_DATA = ("qpos", "qvel", "ctrl", "xfrc_applied")
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class MujocoEngine:
    """A part and a hand under MuJoCo's dynamics, an :class:`~..engine.Engine`.

    Parameters
    ----------
    hand : HandDescription
    part : Part
    settings : VerificationSettings
    """

    def __init__(self, hand: HandDescription, part: Part, settings: VerificationSettings):
        self.hand, self.part, self.settings = hand, part, settings
        self.n_pieces = 0
        self.step_s = 1.0 / settings.mujoco_rate_hz
        self._moments, axes = inertia_of(part)
        self._T_part_body = transform(axes, part.center_of_mass)
        self._moving = [
            joint
            for joint in (int(hand.link_joint[link]) for link in range(hand.n_links))
            if joint >= 0 and joint not in hand.preshape.joints
        ]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.n_pieces = 0

    def use(self, settings: VerificationSettings) -> None:
        """Take another friction and mass from the next :meth:`place` on."""
        self.settings = settings
        if self.n_pieces:
            self._set_friction()

    def take_pieces(self, pieces: Sequence[Array]) -> None:
        """Make the part anew of convex pieces (n, 3) in its frame. Some 0.3 ms a piece."""
        T_body_part = inverse(self._T_part_body)
        self._pieces = [apply(T_body_part, piece) for piece in pieces]
        self.n_pieces = len(pieces)
        self._build()

    def _build(self, hull: Array | None = None) -> None:
        model = build_model(self.hand, self._pieces, self._moments, self.step_s, hull)
        self.model = model
        self.data, self._scratch = mujoco.MjData(model), mujoco.MjData(model)
        self._object = model.body(PART_BODY).id
        self._plane = -1 if hull is None else model.geom(PLANE_GEOM).id
        self._pose = slice(*(model.jnt_qposadr[model.body_jntadr[self._object]] + [0, 7]))
        self._speed = slice(*(model.jnt_dofadr[model.body_jntadr[self._object]] + [0, 6]))
        self._bodies = [model.body(link_body(link)).id for link in range(self.hand.n_links)]
        self._link_of = {body: link for link, body in enumerate(self._bodies)}
        names = {joint: self.hand.joint_names[joint] for joint in self._moving}
        self._angle_at = {j: int(model.joint(name).qposadr[0]) for j, name in names.items()}
        self._speed_at = {j: int(model.joint(name).dofadr[0]) for j, name in names.items()}
        self._motor_at = {j: int(model.actuator(name).id) for j, name in names.items()}
        self._set_friction()

    def place(self, T_palm_part: Array, joints: Array) -> None:
        """Put the part at a pose and the hand at joint angles (J,) [rad], all at rest."""
        model, data = self.model, self.data
        posture = np.zeros(self.hand.n_joints)
        held = self.hand.preshape.joints
        posture[held] = joints[held]
        poses = link_transforms(self.hand, posture)[0]
        for link in range(self.hand.n_links):
            parent = int(self.hand.link_parent[link])
            if int(self.hand.link_joint[link]) in held:
                position, quat_xyzw = to_position_quat_xyzw(inverse(poses[parent]) @ poses[link])
                model.body_pos[self._bodies[link]] = position
                model.body_quat[self._bodies[link]] = np.roll(quat_xyzw, 1)
        mujoco.mj_resetData(model, data)
        position, quat_xyzw = to_position_quat_xyzw(T_palm_part @ self._T_part_body)
        data.qpos[self._pose] = [*position, *np.roll(quat_xyzw, 1)]
        for joint, index in self._angle_at.items():
            data.qpos[index] = joints[joint]
        if self._plane >= 0:
            model.geom_pos[self._plane] = FAR_BELOW
        mujoco.mj_forward(model, data)

    def lay_on(self, T_palm_plane: Array | None, friction: float) -> None:
        """Put a plane under the part, z away from it; None: take it away.

        The first plane costs a new model (10 to 20 ms): trials without one have none.
        """
        if self._plane < 0:
            if T_palm_plane is None:
                return
            self._add_plane()
        model, plane = self.model, self._plane
        T = transform(np.eye(3), FAR_BELOW) if T_palm_plane is None else T_palm_plane
        model.geom_pos[plane], quat_xyzw = to_position_quat_xyzw(T)
        model.geom_quat[plane] = np.roll(quat_xyzw, 1)
        model.geom_friction[plane, 0] = friction
        mujoco.mj_forward(self.model, self.data)

    def _add_plane(self) -> None:
        """The same model and state with a plane that the part's hull can meet."""
        model, data = self.model, self.data
        vertices = self.part.working_mesh.vertices
        corners = vertices[ConvexHull(vertices, qhull_options="QJ").vertices]
        self._build(apply(inverse(self._T_part_body), corners))
        for name in _SET_IN_MODEL:
            getattr(self.model, name)[:] = getattr(model, name)
        for name in _SET_IN_DATA:
            getattr(self.data, name)[:] = getattr(data, name)
        mujoco.mj_setConst(self.model, self._scratch)

    def carry(self, mass_kg: float, damped: bool) -> None:
        """Give the part a mass, and a support that lets it move slowly, or none."""
        model, moments = self.model, mass_kg * self._moments
        model.body_mass[self._object] = mass_kg
        model.body_inertia[self._object] = moments
        rate = _SUPPORT_RATE if damped else 0.0
        model.dof_damping[self._speed] = rate * np.concatenate([np.full(3, mass_kg), moments])
        mujoco.mj_setConst(model, self._scratch)

    def halt(self) -> None:
        """Take the part's velocity from it."""
        self.data.qvel[self._speed] = 0.0

    def step(self, steps: int, force: Array | None) -> None:
        """Let time steps pass with a force (3,) [N] at the part's centre of mass, in P."""
        self.data.xfrc_applied[self._object, :3] = 0.0 if force is None else force
        mujoco.mj_step(self.model, self.data, steps)

    def joint_states(self, joints: Sequence[int]) -> Sequence[tuple[float, float]]:
        """Angle [rad] and speed [rad/s] of some of the hand's joints."""
        qpos, qvel = self.data.qpos, self.data.qvel
        return [(float(qpos[self._angle_at[j]]), float(qvel[self._speed_at[j]])) for j in joints]

    def motor(self, joint: int, speed: float, torque: float) -> None:
        """Let a joint's motor go at a speed [rad/s] with a torque [N m] at most."""
        motor, held = self._motor_at[joint], speed == 0.0
        self.data.ctrl[motor] = speed
        moves = 0.0 if held else torque
        self.model.actuator_forcerange[motor] = (-moves, moves)
        self.model.dof_frictionloss[self._speed_at[joint]] = torque if held else 0.0

    def press_of(self, link: int) -> float:
        """Sum of the normal forces [N] between the part and a link after the last step."""
        return sum(contact.force_n for contact in self.contacts() if contact.link == link)

    def contacts(self) -> list[Contact]:
        """What touches the part after the last step."""
        model, data = self.model, self.data
        found, wrench = [], np.zeros(6)
        for index in range(data.ncon):
            contact = data.contact[index]
            first, second = model.geom_bodyid[contact.geom]
            link = self._link_of.get(int(second if first == self._object else first))
            if link is None:
                continue  # the plane
            mujoco.mj_contactForce(model, data, index, wrench)
            found.append(Contact(link, -float(contact.dist), float(wrench[0])))
        return found

    def part_pose(self) -> Array:
        """T_palm_part, (4, 4)."""
        pose = self.data.qpos[self._pose]
        T = from_position_quat_xyzw(pose[:3], np.roll(pose[3:], -1))
        return T @ inverse(self._T_part_body)

    def save(self) -> Any:
        """Keep the present state for :meth:`restore`."""
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, state, _STATE)
        return state

    def restore(self, state: Any) -> None:
        """Go back to a kept state; the motors are set anew by who drives them."""
        mujoco.mj_setState(self.model, self.data, state, _STATE)
        mujoco.mj_forward(self.model, self.data)

    def forget(self, state: Any) -> None:
        """Nothing to free."""

    def _set_friction(self) -> None:
        shares = self.settings.link_friction_shares(self.hand)
        for body, link in self._link_of.items():
            geoms = self.model.geom_bodyid == body
            self.model.geom_friction[geoms, 0] = shares[link] * self.settings.friction
