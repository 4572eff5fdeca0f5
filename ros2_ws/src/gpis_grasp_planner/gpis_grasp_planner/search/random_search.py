"""The ablations: no model and no charts, and charts without the model.

Both draw palm poses evenly from the search space of HPP-Opt and use the same evaluator. What
HPP-Opt gains over the second is what the Bayesian model buys; what the second gains over the
first is what the local adaption buys.
"""

from __future__ import annotations

from gpis_grasp_planner.geometry.transforms import inverse
from gpis_grasp_planner.search.context import PlanningContext
from gpis_grasp_planner.search.local_adaption import LocalAdaption
from gpis_grasp_planner.search.search_space import PalmSearchSpace

_BATCH = 32


class RandomPalms:
    """Plain random sampling: palm pose and pre-shape at random, close, measure."""

    finished = False

    def __init__(self, context: PlanningContext):
        self._context = context
        self._space = PalmSearchSpace(
            context.part.mesh.bounds, context.settings.hpp.palm_clearance_m
        )
        self._T_face_palm = inverse(context.T_palm_face)

    def step(self) -> None:
        """Try a batch of random palms."""
        c = self._context
        X = self._space.domain.sample(_BATCH, c.rng)
        preshape = c.preshapes.draw(_BATCH, c.rng)
        c.archive.add(c.evaluator.attempt(self._space.poses(X) @ self._T_face_palm, preshape))


class RandomWithAdaption:
    """Random proposals with the local adaption of Alg. 2: HPP-Opt without its model."""

    finished = False

    def __init__(self, context: PlanningContext):
        self._context = context
        self._space = PalmSearchSpace(
            context.part.mesh.bounds, context.settings.hpp.palm_clearance_m
        )
        self._adaption = LocalAdaption.of(context)

    def step(self) -> None:
        """Adapt a batch of random proposals."""
        c = self._context
        X = self._space.domain.sample(c.settings.hpp.batch, c.rng)
        c.archive.add(self._adaption(self._space.poses(X), c.rng).attempts)
