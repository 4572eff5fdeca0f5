"""HPP-Opt (Alg. 1): Bayesian optimisation of the palm pose with local adaption.

A Latin hypercube of palm poses starts the model; then, until the time or the iterations end,
expected improvement proposes poses, the local adaption (Alg. 2) tries its seeds around each, and
the best of the seeds, at the pose where it was found, is told to the model.

Where an attempt costs 1 ms and a proposal of the model 10 ms, one proposal at a time would spend
the budget on the model: `batch` proposals are asked for at once (the paper's form is 1).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.evaluator import Attempts, AttemptStatus
from gpis_grasp_planner.optimise.bayesian import BayesianOptimiser, BayesianSettings
from gpis_grasp_planner.optimise.gaussian_process import GaussianProcessSettings
from gpis_grasp_planner.search.local_adaption import LocalAdaption
from gpis_grasp_planner.search.search_space import PalmSearchSpace

if TYPE_CHECKING:
    from gpis_grasp_planner.search.context import PlanningContext

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Proposals:
    """A batch of the model's proposals and what the local adaption made of them.

    Attributes
    ----------
    X : (k, 6 and more) array
        Search coordinates that were proposed.
    attempts : Attempts
        Of all seeds of all proposals.
    best : (k,) int array
        Index of each proposal's best attempt, -1 where no seed came free.
    values : (k,) array
        Objective of the best attempts, 0 where there is none.
    T_object_face : (k, 4, 4) array
        Pose of the palm's face of the best attempt, or of the proposal.
    posture : (k, p) array
        Spread [rad] and standoff [m] of the same, as far as the model knows them.
    feasible : (k,) bool array
        Which proposals had a seed that no constraint blocked.
    """

    X: Array
    attempts: Attempts
    best: NDArray[np.int64]
    values: Array
    T_object_face: Array
    posture: Array
    feasible: NDArray[np.bool_]


class PalmPoseOptimiser:
    """Alg. 1 as a loop that its caller drives: `step` is one batch of iterations.

    Parameters
    ----------
    context : PlanningContext
        Its archive takes every attempt.
    """

    def __init__(self, context: PlanningContext):
        self._context = context
        self.settings = context.settings.hpp
        self.adaption = LocalAdaption.of(context)
        adapted = self.settings.model_sees == "adapted"
        self.space = PalmSearchSpace(
            context.part.mesh.bounds,
            self.settings.palm_clearance_m,
            self.adaption.destination if adapted else None,
            self._posture_bounds() if self.settings.model_posture else None,
        )
        self.iterations = 0
        self._optimiser = BayesianOptimiser(
            self.space.domain,
            settings=BayesianSettings(
                n_initial=self.settings.n_initial,
                xi=self.settings.xi,
                max_observations=self.settings.max_observations,
            ),
            process_settings=GaussianProcessSettings(noise_std_max=self.settings.noise_std_max),
            to_beat=self._to_beat if self.settings.improvement == "list" else None,
            seed=context.rng.spawn(1)[0],
        )

    @property
    def finished(self) -> bool:
        """Whether n_iter proposals after the start were made."""
        return self.iterations >= self.settings.n_initial + self.settings.n_iter

    def step(self) -> None:
        """Propose, adapt, close, tell."""
        self.tell(self.propose(self.settings.batch))

    def propose(self, batch: int) -> Proposals:
        """Lines 5 to 8 of Alg. 1 for a batch: ask, adapt and close, keep the best of the seeds."""
        left = self.settings.n_initial + self.settings.n_iter - self.iterations
        X = self._optimiser.ask_batch(max(1, min(batch, left)))
        T_object_face = self.space.poses(X)
        posture = X[:, 6:].copy()
        wanted = posture if posture.shape[1] else None
        adapted = self.adaption(T_object_face, self._context.rng, wanted)
        attempts, owner = adapted.attempts, adapted.proposal
        self._context.archive.add(attempts)
        objective = attempts.objective(self._context.objective)
        best, feasible = np.full(len(X), -1), np.ones(len(X), dtype=np.bool_)
        for k in range(len(X)):
            own = np.flatnonzero(owner == k)
            if len(own):
                best[k] = own[np.argmax(objective[own])]
                feasible[k] = self._feasible(attempts, own)
        values = np.where(best >= 0, objective[best] if len(objective) else 0.0, 0.0)
        found = best >= 0
        T_object_face[found] = attempts.T_object_palm[best[found]] @ self.adaption.T_palm_face
        if posture.shape[1]:
            chosen = best[found]
            posture[found] = np.column_stack([attempts.preshape[chosen], adapted.standoff[chosen]])
        self.iterations += len(X)
        return Proposals(X, attempts, best, values, T_object_face, posture, feasible)

    def tell(self, proposals: Proposals) -> None:
        """Lines 9 and 10: tell the values at the poses where they were found."""
        self._optimiser.tell(
            proposals.X,
            proposals.values,
            features=self.space.features_of(proposals.T_object_face, proposals.posture),
            feasible=proposals.feasible,
        )

    def tell_attempts(self, attempts: Attempts, owner: NDArray[np.int64]) -> None:
        """Tell the best attempt of each owner (B,), proposed by others than the model.

        As standoff counts how far the palm's face is from the surface.
        """
        objective = attempts.objective(self._context.objective)
        of_each = [np.flatnonzero(owner == k) for k in np.unique(owner)]
        best = np.array([rows[np.argmax(objective[rows])] for rows in of_each], dtype=np.int64)
        if not len(best):
            return
        T_face = attempts.T_object_palm[best] @ self.adaption.T_palm_face
        X = self.space.coordinates(T_face)
        posture = np.zeros((len(best), 0))
        if self.settings.model_posture:
            _, nearest = self._context.atlas.nearest(T_face[:, :3, 3])
            standoff = np.linalg.norm(T_face[:, :3, 3] - nearest, axis=1)
            posture = np.column_stack([attempts.preshape[best], standoff])
            posture = np.clip(posture, *self._posture_bounds())
            X = np.hstack([X, posture])
        self._optimiser.tell(
            X,
            objective[best],
            features=self.space.features_of(T_face, posture),
            feasible=[self._feasible(attempts, rows) for rows in of_each],
        )

    def _feasible(self, attempts: Attempts, rows: NDArray[np.intp]) -> bool:
        """Whether the model is told a value of these attempts, though all may be blocked."""
        blocked = attempts.status[rows] == AttemptStatus.BLOCKED
        return not (self.settings.learn_feasibility and blocked.all())

    def _posture_bounds(self) -> Array:
        """Ends (2, S + 1) of what the model proposes beside the palm: pre-shape and standoff."""
        preshapes = self._context.preshapes
        standoff = self.adaption.settings.standoff_max_m
        return np.array([[*preshapes.lower, 0.0], [*preshapes.upper, standoff]])

    def _to_beat(self, X: Array) -> Array:
        """What a grasp near each proposal has to beat to enter the list of distinct grasps."""
        return self._context.archive.to_beat(self.space.places(X), self._place_of_palm)

    def _place_of_palm(self, T_object_palm: Array) -> Array:
        return self.adaption.destination(T_object_palm @ self.adaption.T_palm_face)
