"""The search's memory: the best attempts so far, thinned to what is mutually distinct."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.evaluator import Attempts, AttemptStatus
from gpis_grasp_planner.grasp.order import DISTINCT, are_near, distinct
from gpis_grasp_planner.quality.objective import Objective

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Candidate:
    """One attempt out of many, with the objective that ranked it."""

    attempts: Attempts
    index: int
    objective: float

    @property
    def T_object_palm(self) -> Array:
        """Palm pose (4, 4)."""
        return np.asarray(self.attempts.T_object_palm[self.index])

    @property
    def epsilon(self) -> float:
        """Epsilon by the evaluator."""
        return float(self.attempts.epsilon[self.index])

    @property
    def preshape(self) -> Array:
        """Pre-shape of the hand (S,) [rad or m]."""
        return np.asarray(self.attempts.preshape[self.index])


class GraspArchive:
    """The best attempts so far, thinned so that one good neighbourhood cannot fill it.

    Parameters
    ----------
    max_radius : float [m]
        Scale of the distance rule.
    objective : Objective
    capacity : int
    """

    def __init__(self, max_radius: float, objective: Objective, capacity: int = 160):
        self.max_radius = max_radius
        self.objective = objective
        self.capacity = capacity
        self._candidates: list[Candidate] = []
        self.best_attempt: Candidate | None = None
        self._list: list[Candidate] | None = None
        self._places: tuple[Callable[[Array], Array], Array] | None = None

    def __len__(self) -> int:
        return len(self._candidates)

    @property
    def best_epsilon(self) -> float:
        """Largest epsilon in the archive, -1 where it is empty."""
        return max((c.epsilon for c in self._candidates), default=-1.0)

    def add(self, attempts: Attempts) -> None:
        """Take the force-closure grasps among attempts; remember the best of the others."""
        self._list = None
        objective = attempts.objective(self.objective)
        grasped = attempts.status == AttemptStatus.GRASPED
        for i in np.flatnonzero(grasped & (attempts.epsilon > 0.0)):
            self._candidates.append(Candidate(attempts, int(i), float(objective[i])))
        if len(attempts):
            index, best = int(np.argmax(objective)), self.best_attempt
            if grasped[index] and (best is None or objective[index] > best.objective):
                self.best_attempt = Candidate(attempts, index, float(objective[index]))
        if len(self._candidates) > 3 * self.capacity:
            # The largest epsilon may be a neighbour of a grasp with a better objective.
            tightest = max(self._candidates, key=lambda c: c.epsilon)
            self._candidates = self._ranked(self.capacity, 0.5 * DISTINCT)
            if tightest not in self._candidates:
                self._candidates.append(tightest)

    def best(self, n: int, apart: float = DISTINCT) -> list[Candidate]:
        """The `n` best that are `apart` from each other, best first."""
        return self._ranked(n, apart)

    def to_beat(self, T_place: Array, place_of: Callable[[Array], Array], n: int = 20) -> Array:
        """What a grasp at each place (k, 4, 4) must exceed to enter the list.

        The list is the `n` best distinct grasps. A grasp within the distance rule of a listed one
        can only replace it; elsewhere it has to beat the last.

        Parameters
        ----------
        T_place : (k, 4, 4) array
            Poses that stand for the places; not palm poses, since a proposal's standoff is open.
        place_of : callable
            (m, 4, 4) palm poses -> (m, 4, 4) their places.
        n : int
            Length of the list.

        Returns
        -------
        (k,) array
            0 while the list is not full, away from the listed.
        """
        listed = self._listed(n)
        last = listed[-1].objective if len(listed) >= n else 0.0
        threshold = np.full(len(T_place), last)
        if listed:
            if self._places is None or self._places[0] != place_of:
                T = place_of(np.stack([c.T_object_palm for c in listed]))
                self._places = (place_of, T)
            near = are_near(T_place, self._places[1], self.max_radius)
            objective = np.array([c.objective for c in listed])
            threshold = np.maximum(threshold, np.where(near, objective, 0.0).max(axis=1))
        return threshold

    def _listed(self, n: int) -> list[Candidate]:
        """`best(n)`, computed anew only after something was added."""
        if self._list is None or len(self._list) > n:
            self._list, self._places = self._ranked(n, DISTINCT), None
        return self._list

    def _ranked(self, n: int, apart: float) -> list[Candidate]:
        if not self._candidates:
            return []
        objective = np.array([c.objective for c in self._candidates])
        order = np.argsort(-objective, kind="stable")
        T = np.stack([c.T_object_palm for c in self._candidates])
        return [self._candidates[i] for i in distinct(T, order, self.max_radius, n, apart)]
