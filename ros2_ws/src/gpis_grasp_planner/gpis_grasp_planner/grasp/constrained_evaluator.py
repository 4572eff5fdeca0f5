"""An evaluator that respects constraints: what they forbid is not closed, or counts as blocked."""

from __future__ import annotations

from collections import Counter
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.grasp.constraint import ClosedHands, Constraint, allowed
from gpis_grasp_planner.grasp.evaluator import (
    Attempts,
    AttemptStatus,
    PostureEvaluator,
    Postures,
)
from gpis_grasp_planner.grasp.open_hand import open_postures
from gpis_grasp_planner.hand.description import HandDescription

Array = NDArray[np.float64]


class ConstrainedEvaluator:
    """Implements `grasp.evaluator.PostureEvaluator` on top of another one.

    Hands whose start a constraint does not allow are not closed: status BLOCKED, epsilon -1. An
    attempt with force closure that a constraint blocks afterwards gets the same, and the
    translation that would have freed it, where that is known (`Attempts.shift`). Without
    constraints the other evaluator's attempts are passed on as they are.

    Parameters
    ----------
    evaluator : PostureEvaluator
    hand : HandDescription
    constraints : sequence of Constraint
        Asked in this order; the first that objects gives the cause.
    retreat_m : float [m]
        Length of the approach.

    Attributes
    ----------
    blocked : Counter of str
        Attempts with force closure that were blocked so far, by cause.
    screened : Counter of str
        Hands that were not closed, by the constraint's name.

    Notes
    -----
    Some 0.02 ms for each hand before the closing and a plane, 0.2 ms for each with force closure.
    """

    def __init__(
        self,
        evaluator: PostureEvaluator,
        hand: HandDescription,
        constraints: tuple[Constraint, ...],
        retreat_m: float,
    ):
        self._evaluator = evaluator
        self._hand = hand
        self.constraints = tuple(constraints)
        self._retreat = retreat_m
        self.blocked: Counter[str] = Counter()
        self.screened: Counter[str] = Counter()

    @property
    def friction(self) -> Friction:
        """Friction of the pairs of hand link and object."""
        return self._evaluator.friction

    @property
    def n_attempts(self) -> int:
        """Grasp attempts so far, with those that were not closed."""
        return self._evaluator.n_attempts + self.screened.total()

    @property
    def n_states(self) -> int:
        """States whose guided potential was asked for so far."""
        return self._evaluator.n_states

    def attempt(self, T_object_palm: Array, spread: Array) -> Attempts:
        """Close the hand at poses (B, 4, 4) with spreads (B,) [rad]."""
        if not self.constraints:
            return self._evaluator.attempt(T_object_palm, spread)
        free = self._screen(T_object_palm, open_postures(self._hand, spread))
        made = self._evaluator.attempt(T_object_palm[free], spread[free])
        return self._judged(_among(made, free, T_object_palm, spread, None))

    def attempt_from(self, T_object_palm: Array, joints: Array) -> Attempts:
        """Close the hand at poses (B, 4, 4) from postures (B, J) [rad]."""
        if not self.constraints:
            return self._evaluator.attempt_from(T_object_palm, joints)
        free = self._screen(T_object_palm, joints)
        made = self._evaluator.attempt_from(T_object_palm[free], joints[free])
        spreading = [f.spread_joint for f in self._hand.fingers if f.spread_joint >= 0]
        spread = joints[:, spreading].mean(axis=1) if spreading else np.zeros(len(joints))
        return self._judged(_among(made, free, T_object_palm, spread, joints))

    def postures(self, T_object_palm: Array, motors: Array) -> Postures:
        """Hands at given motor angles; see the protocol."""
        return self._evaluator.postures(T_object_palm, motors)

    def clear_palm(
        self, T_object_palm: Array, normals_outward: Array, spread: Array, standoff: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Move open hands along the normals until the part leaves them free; see the protocol."""
        return self._evaluator.clear_palm(T_object_palm, normals_outward, spread, standoff)

    def approach(
        self, T_object_palm: Array, joints: Array, reach: float
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Move free hands along the palm's axis until they touch; see the protocol."""
        return self._evaluator.approach(T_object_palm, joints, reach)

    def guided_potential(self, T_object_palm: Array, joints: Array) -> Array:
        """Guided potential quality energies (B,); inf where a constraint forbids the hand."""
        energy = self._evaluator.guided_potential(T_object_palm, joints)
        if not self.constraints:
            return energy
        return np.where(allowed(self.constraints, T_object_palm, joints), energy, np.inf)

    def _screen(self, T: Array, joints: Array) -> NDArray[np.bool_]:
        free = np.ones(len(T), dtype=np.bool_)
        for constraint in self.constraints:
            before = int(free.sum())
            if not before:
                break
            free[free] = constraint.allows(T[free], joints[free])
            if lost := before - int(free.sum()):
                self.screened[constraint.name] += lost
        return free

    def _judged(self, attempts: Attempts) -> Attempts:
        closed = (attempts.status == AttemptStatus.GRASPED) & (attempts.epsilon > 0.0)
        rows = np.flatnonzero(closed)
        bad = np.zeros(len(attempts), dtype=np.bool_)
        shift = np.zeros((len(attempts), 3))
        hands = ClosedHands.of(self._hand, attempts, rows, self._retreat)
        for constraint in self.constraints:
            if not len(rows):
                break
            verdict = constraint.verdict(hands)
            objects = verdict.blocked
            self.blocked.update(verdict.cause[objects])
            bad[rows[objects]] = True
            shift[rows[objects]] = verdict.shift[objects]
            rows, hands = rows[~objects], hands.only(~objects)
        return replace(
            attempts,
            status=np.where(bad, AttemptStatus.BLOCKED, attempts.status),
            epsilon=np.where(bad, -1.0, attempts.epsilon),
            volume=np.where(bad, 0.0, attempts.volume),
            shift=shift,
        )


def _among(
    made: Attempts,
    free: NDArray[np.bool_],
    T_object_palm: Array,
    spread: Array,
    start: Array | None,
) -> Attempts:
    """The attempts of the free rows, among rows that were not tried."""
    if free.all():
        return made
    n, values = len(free), {}
    for field in fields(made):
        value = getattr(made, field.name)
        if isinstance(value, np.ndarray):
            values[field.name] = np.zeros((n, *value.shape[1:]), dtype=value.dtype)
            values[field.name][free] = value
    values["status"][~free] = AttemptStatus.BLOCKED
    values["epsilon"][~free] = -1.0
    values["T_object_palm"][~free] = T_object_palm[~free]
    values["spread"][~free] = spread[~free]
    if start is not None:
        values["start_joints"][~free] = start[~free]
        values["joints"][~free] = start[~free]
    return Attempts(**values)
