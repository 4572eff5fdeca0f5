"""Second stage, improved: the contacts of good grasps refined by direct search.

The paper's second stage (`admm_cp_opt`) optimises the finger joints with the palm on a chart and
has to bring the contacts back onto the surface by a penalty. Closing the hand does that by
construction: with the palm and the spread given, AutoGrasp and the drive's coupling leave one
posture, whose contacts lie on the surface exactly. What is free is where the palm lies and how
the fingers are spread, and that is searched here: every distinct grasp found so far is moved a
little (along its chart, across it, about all axes, in spread), closed anew, and kept where it
improved. Step sizes are drawn from a wide range instead of being adapted, since a grasp's quality
jumps when a contact appears or goes.

One step tries `samples` neighbours of one grasp, some 10 to 30 ms.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.transforms import inverse, transform
from gpis_grasp_planner.planning.ranking import Candidate

if TYPE_CHECKING:
    from gpis_grasp_planner.planning.context import PlanningContext


class ContactRefinement:
    """Round-robin direct search over the archive's distinct grasps.

    Parameters
    ----------
    context : PlanningContext
        Its archive gives the grasps and takes what is found.
    """

    def __init__(self, context: PlanningContext):
        self._context = context
        self.settings = context.settings.refinement
        self._queue: list[Candidate] = []

    @property
    def ready(self) -> bool:
        """Whether there is anything to refine."""
        return len(self._context.archive) > 0

    def step(self) -> None:
        """Try neighbours of the next grasp; does nothing while the archive is empty."""
        if not self._queue:
            self._queue = self._context.archive.best(self.settings.n_grasps)[::-1]
        if not self._queue:
            return
        c = self._context
        T, spread = self._neighbours(self._queue.pop(), c.rng)
        c.archive.add(c.evaluator.attempt(T, spread))

    def _neighbours(
        self, candidate: Candidate, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        s = self.settings
        n = s.samples
        scale = np.exp(rng.uniform(np.log(s.step_min), 0.0, n))
        shift = s.step_translation_m * scale[:, None] * rng.standard_normal((n, 3))
        turn = np.deg2rad(s.step_rotation_deg) * scale[:, None] * rng.standard_normal((n, 3))
        widen = np.deg2rad(s.step_spread_deg) * scale * rng.standard_normal(n)
        # In a third of the tries each, only the place on the chart or only the posture moves.
        what = rng.integers(3, size=n)
        turn[what == 1] = 0.0
        shift[what == 2] = 0.0
        T_palm_moved = transform(Rotation.from_rotvec(turn).as_matrix(), shift)
        # The turn is about the palm's face, where the object is, not about the flange.
        T_face = self._context.T_palm_face
        T_face_palm = inverse(T_face)
        T = candidate.T_object_palm @ T_face @ T_palm_moved @ T_face_palm
        limit = np.deg2rad(self._context.settings.adaption.spread_max_deg)
        return T, np.clip(candidate.spread + widen, 0.0, limit)
