"""First-stage grasps that are not among the best, refined by successive halving.

How good a grasp is where the first stage found it does not say how good it gets: fingertips that
hardly hold may lie beside one of the best grasps of the part, while the hand that is pressed flat
onto a face is where it ends. Refining the best only, such a grasp has
to be found by luck. So any grasp of the first stage may start: one turn each, the better half of
them two, the better half of those four, and so on.

Starts are drawn with a chance proportional to their objective, and none that lies near where
another one started or has got to.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.evaluator import Attempts
from gpis_grasp_planner.optimise.successive_halving import SuccessiveHalving
from gpis_grasp_planner.search.refinement.neighbourhood import Neighbourhood

if TYPE_CHECKING:
    from gpis_grasp_planner.search.context import PlanningContext

Array = NDArray[np.float64]

_POOL = 3000
_DRAWS = 30


@dataclass
class _Run:
    """One start: where it has got to, and where it goes on."""

    T_object_palm: Array
    preshape: Array
    objective: float


class StartTournament:
    """Local searches from many first-stage grasps, most of them given up early.

    Parameters
    ----------
    context : PlanningContext
        Its archive takes what is found.
    neighbourhood : Neighbourhood
    """

    def __init__(self, context: PlanningContext, neighbourhood: Neighbourhood):
        self._rng = context.rng
        self._objective_of = context.objective
        self._settings = s = context.settings.refinement
        self._neighbourhood = neighbourhood
        self._halving = SuccessiveHalving(s.tournament_rungs, s.tournament_ratio)
        self._runs: list[_Run] = []
        self._now: tuple[int, int] | None = None
        self._turns_left = 0
        self._T = np.zeros((0, 4, 4))
        self._preshape = np.zeros((0, len(context.preshapes)))
        self._objective = np.zeros(0)
        self._taken_T = np.zeros((0, 4, 4))
        self._taken_preshape = np.zeros((0, len(context.preshapes)))

    @property
    def n_starts(self) -> int:
        """Starts so far."""
        return len(self._runs)

    def consider(self, attempts: Attempts) -> None:
        """Take the grasps of the first stage into the pool of possible starts."""
        objective = attempts.objective(self._objective_of)
        good = objective > 0.0
        self._T = np.concatenate([self._T, attempts.T_object_palm[good]])
        self._preshape = np.concatenate([self._preshape, attempts.preshape[good]])
        self._objective = np.concatenate([self._objective, objective[good]])
        if len(self._objective) > 2 * _POOL:
            self._keep(np.argsort(-self._objective, kind="stable")[:_POOL])

    def step(self) -> bool:
        """One turn of the run whose turn it is; False where there is none and none to begin."""
        if self._now is None and not self._next():
            return False
        assert self._now is not None
        start, rung = self._now
        run = self._runs[start]
        T, preshape, objective = self._neighbourhood.attempt(run.T_object_palm, run.preshape)
        if objective > run.objective:
            run.T_object_palm, run.preshape, run.objective = T, preshape, objective
        self._turns_left -= 1
        if self._turns_left == 0:
            self._halving.report(start, rung, run.objective)
            self._now = None
        return True

    def _next(self) -> bool:
        self._now = self._halving.promote() or self._begin()
        if self._now is not None:
            self._turns_left = self._halving.turns(self._now[1])
        return self._now is not None

    def _begin(self) -> tuple[int, int] | None:
        """Draw a start; whatever lies near one that was begun leaves the pool on the way.

        None, too, where all of a number of draws did: a step shall stay short, and others wait.
        """
        for _ in range(min(_DRAWS, len(self._objective))):
            n = len(self._objective)
            k = int(self._rng.choice(n, p=self._objective / self._objective.sum()))
            T, preshape, objective = self._T[k], self._preshape[k], float(self._objective[k])
            self._keep(np.delete(np.arange(n), k))
            if not self._is_taken(T, preshape):
                self._runs.append(_Run(T, preshape, objective))
                self._taken_T = np.concatenate([self._taken_T, T[None]])
                self._taken_preshape = np.concatenate([self._taken_preshape, preshape[None]])
                return len(self._runs) - 1, 0
        return None

    def _is_taken(self, T: Array, preshape: Array) -> bool:
        if not self._runs:
            return False
        now_T = np.stack([run.T_object_palm for run in self._runs])
        now_preshape = np.array([run.preshape for run in self._runs])
        steps = self._neighbourhood.steps_between(
            np.concatenate([self._taken_T, now_T]),
            np.concatenate([self._taken_preshape, now_preshape]),
            T,
            preshape,
        )
        return bool(np.any(steps < self._settings.tournament_apart))

    def _keep(self, rows: NDArray[np.intp]) -> None:
        self._T, self._preshape = self._T[rows], self._preshape[rows]
        self._objective = self._objective[rows]
