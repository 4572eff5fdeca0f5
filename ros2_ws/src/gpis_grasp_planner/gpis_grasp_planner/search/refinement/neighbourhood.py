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
        self._rotation = np.deg2rad(s.step_rotation_deg)
        self._preshapes = context.preshapes
        self._preshape_step = self._preshapes.step(s.step_spread_deg)
        self._T_palm_face = context.T_palm_face
        self._fitting = HandFitting(context)

    def attempt(self, T_object_palm: Array, preshape: Array) -> tuple[Array, Array, float]:
        """Try `samples` neighbours of a grasp; pose (4, 4), pre-shape, objective of the best."""
        context = self._context
        T, preshapes = self.draw(T_object_palm, preshape, context.rng)
        attempts = self._fitting.attempt(T, preshapes)
        context.archive.add(attempts)
        objective = attempts.objective(context.objective)
        best = int(np.argmax(objective))
        return (
            attempts.T_object_palm[best].copy(),
            attempts.preshape[best].copy(),
            float(objective[best]),
        )

    def draw(
        self, T_object_palm: Array, preshape: Array, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """Poses (n, 4, 4) and pre-shapes (n, S) of `samples` neighbours."""
        s = self._settings
        n = s.samples
        scale = np.exp(rng.uniform(np.log(s.step_min), 0.0, n))
        shift = s.step_translation_m * scale[:, None] * rng.standard_normal((n, 3))
        turn = self._rotation * scale[:, None] * rng.standard_normal((n, 3))
        change = self._preshape_step * scale[:, None]
        change = change * rng.standard_normal((n, len(self._preshapes)))
        # In a third of the tries each, only the place on the chart or only the posture moves.
        what = rng.integers(3, size=n)
        turn[what == 1] = 0.0
        shift[what == 2] = 0.0
        T_face_moved = transform(Rotation.from_rotvec(turn).as_matrix(), shift)
        # The turn is about the palm's face, where the object is, not about the flange.
        T_face_palm = inverse(self._T_palm_face)
        T = T_object_palm @ self._T_palm_face @ T_face_moved @ T_face_palm
        return T, self._preshapes.clip(preshape + change)

    def steps_between(self, T_1: Array, preshape_1: Array, T_2: Array, preshape_2: Array) -> Array:
        """How many of the largest steps lie between palms (n, 4, 4) and one palm (4, 4): (n,).

        The root of the sum of squares over translation of the palm's face, rotation and
        the pre-shape's motors.
        """
        shift = ((T_1 - T_2) @ self._T_palm_face)[:, :3, 3]
        largest = [self._settings.step_translation_m, self._rotation, *self._preshape_step]
        apart = np.stack(
            [
                np.linalg.norm(shift, axis=1),
                rotation_angle(T_1[:, :3, :3], T_2[:3, :3]),
                *np.abs(preshape_1 - preshape_2).T,
            ]
        )
        steps = np.maximum(largest, _SMALLEST_STEP)
        return np.asarray(np.linalg.norm(apart / steps[:, None], axis=0))
