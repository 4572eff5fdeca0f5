"""The variables of the annealing planners: palm pose and eigengrasp amplitudes.

A state is (tx, ty, tz, theta, phi, alpha, a_1, ..): the position of the palm's face from the
object's centre of mass [m], its orientation as the turn alpha about the axis with polar angles
theta and phi, and one amplitude for each eigengrasp. Ranges and largest steps are the original
simulator's. It measures positions from the object's origin; from the centre of mass a mesh with
its origin elsewhere is no worse off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_benchmark.rivals.settings import RivalSettings
from gpis_grasp_planner.geometry.transforms import inverse
from gpis_grasp_planner.search.context import PlanningContext

Array = NDArray[np.float64]

POSE_LOWER = np.array([-0.25, -0.25, -0.25, 0.0, -np.pi, 0.0])
POSE_UPPER = np.array([0.25, 0.25, 0.35, np.pi, np.pi, np.pi])
POSE_STEP = np.array([0.15, 0.15, 0.15, np.pi / 5, np.pi / 2, np.pi / 2])
PHI = 4
N_POSE = 6
AMPLITUDE_STEPS = 4
"""An amplitude's range over its largest step."""


@dataclass(frozen=True, eq=False)
class Variables:
    """Ranges of the variables (dim,), their largest steps, and which of them wrap around."""

    lower: Array
    upper: Array
    largest_step: Array
    periodic: NDArray[np.bool_]


class HandStates:
    """States (B, dim) to hands: palm poses and joints.

    Parameters
    ----------
    context : PlanningContext
    settings : RivalSettings, optional
    """

    def __init__(self, context: PlanningContext, settings: RivalSettings | None = None):
        hand = context.hand
        n = len(hand.eigengrasps.directions)
        limit = np.full(n, hand.eigengrasps.amplitude_limit)
        lower = np.concatenate([POSE_LOWER, -limit])
        upper = np.concatenate([POSE_UPPER, limit])
        step = np.concatenate([POSE_STEP, 2.0 * limit / AMPLITUDE_STEPS])
        if (settings or RivalSettings()).largest_step == "range":
            step = upper - lower
        self.variables = Variables(lower, upper, step, np.arange(N_POSE + n) == PHI)
        self._center = np.asarray(context.part.center_of_mass, dtype=float)
        self._T_face_palm = inverse(context.T_palm_face)
        self._hand = hand
        self._joints_of_motors = np.zeros((len(hand.motor_upper), hand.n_joints))
        self._joints_of_motors[: len(hand.preshape), hand.preshape.joints] = hand.preshape.gain
        for motor, finger in enumerate(hand.fingers, start=len(hand.preshape)):
            self._joints_of_motors[motor, list(finger.joints)] = finger.closing_ratio[0]

    def faces(self, states: Array) -> Array:
        """Poses T_object_face (B, 4, 4) of the palm's face."""
        theta, phi, alpha = states[:, 3], states[:, 4], states[:, 5]
        sine = np.sin(theta)
        x, y, z = sine * np.cos(phi), sine * np.sin(phi), np.cos(theta)
        c, s = np.cos(alpha), np.sin(alpha)
        k = 1.0 - c
        T = np.zeros((len(states), 4, 4))
        T[:, 0, 0], T[:, 0, 1], T[:, 0, 2] = c + k * x * x, k * x * y - s * z, k * x * z + s * y
        T[:, 1, 0], T[:, 1, 1], T[:, 1, 2] = k * y * x + s * z, c + k * y * y, k * y * z - s * x
        T[:, 2, 0], T[:, 2, 1], T[:, 2, 2] = k * z * x - s * y, k * z * y + s * x, c + k * z * z
        T[:, :3, 3] = self._center + states[:, :3]
        T[:, 3, 3] = 1.0
        return T

    def motors(self, states: Array) -> Array:
        """Motor angles (B, n_motors) [rad]: origin + amplitudes @ directions, within limits."""
        grasps = self._hand.eigengrasps
        motors = grasps.origin + states[:, N_POSE:] @ grasps.directions
        return np.asarray(np.clip(motors, self._hand.motor_lower, self._hand.motor_upper))

    def hands(self, states: Array) -> tuple[Array, Array]:
        """Palm poses T_object_palm (B, 4, 4) and joints (B, J) [rad] of states (B, dim)."""
        joints = self.motors(states) @ self._joints_of_motors
        limited = np.clip(joints, self._hand.joint_lower, self._hand.joint_upper)
        return self.faces(states) @ self._T_face_palm, limited
