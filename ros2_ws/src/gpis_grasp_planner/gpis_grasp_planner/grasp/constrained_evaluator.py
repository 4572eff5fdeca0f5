"""An evaluator that respects constraints: what they forbid is not closed, or counts as blocked."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.grasp.constraint import ClosedHands, Constraint, Verdict, allowed
from gpis_grasp_planner.grasp.evaluator import (
    Attempts,
    AttemptStatus,
    PostureEvaluator,
    Postures,
)
from gpis_grasp_planner.grasp.funnel import Step
from gpis_grasp_planner.grasp.open_hand import open_postures
from gpis_grasp_planner.grasp.tally import Tally
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.drive import joints_from_motors, motors_from_joints, touch_motors

Array = NDArray[np.float64]

# Starts nearer to the grasp, where the way of open fingers is blocked: before the first contact.
_BACK_RAD = (0.5, 0.2)


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
    tally : Tally
        What was proposed so far, and what was lost up to the surroundings (`grasp.tally`).

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
        self.tally = Tally()
        self._n_screened = 0

    @property
    def friction(self) -> Friction:
        """Friction of the pairs of hand link and object."""
        return self._evaluator.friction

    @property
    def n_attempts(self) -> int:
        """Grasp attempts so far, with those that were not closed."""
        return self._evaluator.n_attempts + self._n_screened

    @property
    def n_states(self) -> int:
        """States whose guided potential was asked for so far."""
        return self._evaluator.n_states

    def attempt(self, T_object_palm: Array, preshape: Array) -> Attempts:
        """Close the hand at poses (B, 4, 4) with pre-shapes (B, S).

        Where the way of open fingers is blocked the hand starts narrower, and `start_joints` say
        so: the fingers have no memory before their first contact, so that the grasp is the same.
        """
        if not self.constraints:
            return self._counted(self._evaluator.attempt(T_object_palm, preshape))
        opened = open_postures(self._hand, preshape)
        free = self._screen(T_object_palm, opened, palm=True)
        made = self._evaluator.attempt(T_object_palm[free], preshape[free])
        made = replace(made, start_joints=opened[free])
        attempts = _among(made, free, T_object_palm, opened, preshape)
        found = self._judge(attempts, _grasped(attempts))
        for back in _BACK_RAD:
            if not found.blocked.any():
                break
            attempts, found = self._narrowed(attempts, found, back)
        return self._marked(attempts, found)

    def attempt_from(self, T_object_palm: Array, joints: Array) -> Attempts:
        """Close the hand at poses (B, 4, 4) from postures (B, J) [rad]."""
        if not self.constraints:
            return self._counted(self._evaluator.attempt_from(T_object_palm, joints))
        free = self._screen(T_object_palm, joints)
        made = self._evaluator.attempt_from(T_object_palm[free], joints[free])
        attempts = _among(made, free, T_object_palm, joints, self._hand.preshape.of(joints))
        return self._marked(attempts, self._judge(attempts, _grasped(attempts)))

    def postures(self, T_object_palm: Array, motors: Array) -> Postures:
        """Hands at given motor angles; see the protocol."""
        return self._evaluator.postures(T_object_palm, motors)

    def clear_palm(
        self, T_object_palm: Array, normals_outward: Array, preshape: Array, standoff: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Move open hands along the normals until the part leaves them free; see the protocol."""
        T, free = self._evaluator.clear_palm(T_object_palm, normals_outward, preshape, standoff)
        self.tally.reject(T_object_palm, free)
        return T, free

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

    def _screen(self, T: Array, joints: Array, palm: bool = False) -> NDArray[np.bool_]:
        free = np.ones(len(T), dtype=np.bool_)
        for constraint in self.constraints:
            allows = constraint.allows_palm if palm else constraint.allows
            before = free.copy()
            if not before.any():
                break
            free[free] = allows(T[free], joints[free])
            lost = before & ~free
            self._n_screened += int(lost.sum())
            self.tally.lose_at(Step.PALM_FREE, constraint.name, T[lost])
        return free

    def _narrowed(
        self, attempts: Attempts, found: Verdict, back: float
    ) -> tuple[Attempts, Verdict]:
        """Start the blocked hands at most `back` [rad, or `closing_unit`] before first contact."""
        rows = np.flatnonzero(found.blocked)
        preshape, _ = motors_from_joints(self._hand, attempts.joints[rows])
        touch = touch_motors(self._hand, attempts.joints[rows])
        wider = np.maximum(touch - back * self._hand.closing_unit, 0.0)
        start = joints_from_motors(self._hand, preshape, wider)
        wide = attempts.start_joints
        assert wide is not None
        trial = replace(attempts, start_joints=_with_rows(wide, rows, start))
        seen = self._judge(trial, rows)
        cause, shift = found.cause.copy(), _with_rows(found.shift, rows, seen.shift[rows])
        cause[rows[seen.blocked[rows]]] = seen.cause[rows[seen.blocked[rows]]]
        clear = rows[~seen.blocked[rows]]
        if not len(clear):
            return attempts, Verdict(cause, shift)
        # The part may be in the way of a hand that starts narrower.
        again = self._evaluator.attempt_from(
            attempts.T_object_palm[clear], start[~seen.blocked[rows]]
        )
        good = self._judge(again, _grasped(again))
        kept = np.zeros(len(again), dtype=np.bool_)
        kept[_grasped(again)] = True
        kept &= ~good.blocked
        cause[clear[kept]] = None
        merged: dict[str, Any] = {
            field.name: _with_rows(
                getattr(attempts, field.name), clear[kept], getattr(again, field.name)[kept]
            )
            for field in fields(attempts)
            if getattr(attempts, field.name) is not None
        }
        return replace(attempts, **merged), Verdict(cause, shift)

    def _judge(self, attempts: Attempts, rows: NDArray[np.intp]) -> Verdict:
        """What the constraints say of some rows of attempts; the others are clear."""
        verdict = Verdict.clear(len(attempts))
        hands = ClosedHands.of(self._hand, attempts, rows, self._retreat)
        for constraint in self.constraints:
            if not len(rows):
                break
            found = constraint.verdict(hands)
            objects = found.blocked
            verdict.cause[rows[objects]] = found.cause[objects]
            verdict.shift[rows[objects]] = found.shift[objects]
            rows, hands = rows[~objects], hands.only(~objects)
        return verdict

    def _marked(self, attempts: Attempts, found: Verdict) -> Attempts:
        bad = found.blocked
        for cause in dict.fromkeys(found.cause[bad]):
            self.tally.lose_at(Step.CLEAR, cause, attempts.T_object_palm[found.cause == cause])
        return self._counted(
            replace(
                attempts,
                status=np.where(bad, AttemptStatus.BLOCKED, attempts.status),
                epsilon=np.where(bad, -1.0, attempts.epsilon),
                volume=np.where(bad, 0.0, attempts.volume),
                shift=np.where(bad[:, None], found.shift, 0.0),
            )
        )

    def _counted(self, attempts: Attempts) -> Attempts:
        self.tally.propose(attempts)
        return attempts


def _grasped(attempts: Attempts) -> NDArray[np.intp]:
    """Rows with force closure."""
    return np.flatnonzero((attempts.status == AttemptStatus.GRASPED) & (attempts.epsilon > 0.0))


def _with_rows(values: Array, rows: NDArray[np.intp], new: Array) -> Array:
    """A copy with other rows (n, ...) at the given places."""
    values = np.array(values)
    values[rows] = new
    return values


def _among(
    made: Attempts,
    free: NDArray[np.bool_],
    T_object_palm: Array,
    joints: Array,
    preshape: Array,
) -> Attempts:
    """The attempts of the free rows, among rows that were not tried."""
    if free.all():
        return made
    n = len(free)
    values: dict[str, Any] = {}
    for field in fields(made):
        value = getattr(made, field.name)
        if value is not None:
            values[field.name] = np.zeros((n, *value.shape[1:]), dtype=value.dtype)
            values[field.name][free] = value
    values["status"][~free] = AttemptStatus.BLOCKED
    values["epsilon"][~free] = -1.0
    values["T_object_palm"][~free] = T_object_palm[~free]
    values["preshape"][~free] = preshape[~free]
    values["joints"][~free] = values["start_joints"][~free] = joints[~free]
    return Attempts(**values)
