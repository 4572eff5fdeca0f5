"""Neighbours of a grasp: the palm moved a little along its chart, across it and about all axes.

Step sizes are drawn from a wide range instead of being adapted, since a grasp's quality jumps when
a contact appears or goes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.transforms import inverse, rotation_angle, transform
from gpis_grasp_planner.search.hand_fitting import HandFitting

if TYPE_CHECKING:
    from gpis_grasp_planner.search.context import PlanningContext

Array = NDArray[np.float64]

_SMALLEST_STEP = 1e-9


class Neighbourhood:
    """Draws and tries neighbours, and measures how far grasps are from each other in such steps.

    Parameters
    ----------
    context : PlanningContext
        Its archive takes what is tried.
    """

    def __init__(self, context: PlanningContext):
        self._context = context
        self._settings = s = context.settings.refinement
        self._rotation, self._spread = np.deg2rad([s.step_rotation_deg, s.step_spread_deg])
        self._spread_max = np.deg2rad(context.settings.adaption.spread_max_deg)
        self._T_palm_face = context.T_palm_face
        self._fitting = HandFitting(context)

    def attempt(self, T_object_palm: Array, spread: float) -> tuple[Array, float, float]:
        """Try `samples` neighbours of a grasp: pose (4, 4), spread and objective of their best."""
        context = self._context
        T, spreads = self.draw(T_object_palm, spread, context.rng)
        attempts = self._fitting.attempt(T, spreads)
        context.archive.add(attempts)
        objective = attempts.objective(context.objective)
        best = int(np.argmax(objective))
        return (
            attempts.T_object_palm[best].copy(),
            float(attempts.spread[best]),
            float(objective[best]),
        )

    def draw(
        self, T_object_palm: Array, spread: float, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """Poses (n, 4, 4) and spreads (n,) [rad] of `samples` neighbours."""
        s = self._settings
        n = s.samples
        scale = np.exp(rng.uniform(np.log(s.step_min), 0.0, n))
        shift = s.step_translation_m * scale[:, None] * rng.standard_normal((n, 3))
        turn = self._rotation * scale[:, None] * rng.standard_normal((n, 3))
        widen = self._spread * scale * rng.standard_normal(n)
        # In a third of the tries each, only the place on the chart or only the posture moves.
        what = rng.integers(3, size=n)
        turn[what == 1] = 0.0
        shift[what == 2] = 0.0
        T_face_moved = transform(Rotation.from_rotvec(turn).as_matrix(), shift)
        # The turn is about the palm's face, where the object is, not about the flange.
        T_face_palm = inverse(self._T_palm_face)
        T = T_object_palm @ self._T_palm_face @ T_face_moved @ T_face_palm
        return T, np.clip(spread + widen, 0.0, self._spread_max)

    def steps_between(self, T_1: Array, spread_1: Array, T_2: Array, spread_2: float) -> Array:
        """How many of the largest steps lie between palms (n, 4, 4) and one palm (4, 4): (n,).

        The root of the sum of squares over translation of the palm's face, rotation and spread.
        """
        shift = ((T_1 - T_2) @ self._T_palm_face)[:, :3, 3]
        steps = np.maximum(
            [self._settings.step_translation_m, self._rotation, self._spread], _SMALLEST_STEP
        )
        apart = np.stack(
            [
                np.linalg.norm(shift, axis=1),
                rotation_angle(T_1[:, :3, :3], T_2[:3, :3]),
                np.abs(spread_1 - spread_2),
            ]
        )
        return np.asarray(np.linalg.norm(apart / steps[:, None], axis=0))
