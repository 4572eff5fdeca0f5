"""The narrow interface between the planner and whatever closes the hand.

The planner sees palm poses in and closed hands out, many at a time. Two evaluators implement it:
the compiled one (`scene.compiled_evaluator`), which the search uses, and PyBullet's
(`scene.bullet_evaluator`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.quality.figures import Quality
from gpis_grasp_planner.quality.objective import Objective, worth

Array = NDArray[np.float64]


class AttemptStatus(IntEnum):
    """How an attempt to grasp ended; NOT_TRIED where the time was over before it began."""

    GRASPED = 0
    PALM_COLLISION = 1
    SELF_COLLISION = 2
    TOO_FEW_CONTACTS = 3
    NO_WAY_BACK = 4
    BLOCKED = 5
    NOT_TRIED = 6


@dataclass(frozen=True, eq=False)
class Attempts:
    """Results of B attempts, in the object's frame.

    Attributes
    ----------
    T_object_palm : (B, 4, 4) array
        Where the hands closed: where they were asked to, but for a coupled hand, whose palm is
        moved along its jaws' line until both touch (`scene.centring`).
    preshape : (B, S) array [rad or m]
        Pre-shape of the hand, which it keeps while it closes.
    status : (B,) int array of AttemptStatus
    joints : (B, J) array [rad]
        The closed hand.
    n_contacts : (B,) int array
    positions, normals_inward : (B, K, 3) arrays
    friction, links : (B, K) arrays
        Contacts; rows beyond `n_contacts` are not set.
    epsilon : (B,) array
        -1 without force closure. May be an upper bound (`fast_epsilon`).
    volume : (B,) array
        Estimate of the wrench space's volume.
    start_joints : (B, J) array [rad] or None
        Postures from which the fingers closed; None where they were open.
    shift : (B, 3) array [m] or None
        Where a constraint blocked the closed hand: the translation that would free it, zero where
        none is known (`grasp.constraint.Verdict`). None without constraints.
    imbalance : (B,) array or None
        What the closing hand's own forces leave unbalanced of a push, over the push; 0 without
        force closure. None where nobody asked (`grasp.balanced_evaluator`).
    columns : mapping of str to (B,) array, or None
        Figures of the measures that the objective needs, by name; NaN without force closure. None
        where it needs none (`grasp.measured_evaluator`).
    """

    T_object_palm: Array
    preshape: Array
    status: NDArray[np.int64]
    joints: Array
    n_contacts: NDArray[np.int64]
    positions: Array
    normals_inward: Array
    friction: Array
    links: NDArray[np.int64]
    epsilon: Array
    volume: Array
    start_joints: Array | None = None
    shift: Array | None = None
    imbalance: Array | None = None
    columns: Mapping[str, Array] | None = None

    def __len__(self) -> int:
        return len(self.status)

    @property
    def measured(self) -> Mapping[str, Array]:
        """Figures of measures, by name."""
        return self.columns or {}

    def objective(self, objective: Objective) -> Array:
        """What an objective makes of them, (B,); 0 for failed attempts.

        Beyond the paper, where the imbalance is known: times its `balance_factor`.
        """
        return np.where(self.status == AttemptStatus.GRASPED, worth(objective, self), 0.0)

    def objective_of_grasps(self, objective: Objective) -> Array:
        """The same, and 0 without force closure: the paper's formula has a volume then, too."""
        return np.where(self.epsilon > 0.0, self.objective(objective), 0.0)

    def quality(self, index: int) -> Quality:
        """The figures of one attempt; epsilon may be an upper bound, volume is an estimate."""
        return Quality(
            float(self.epsilon[index]),
            float(self.volume[index]),
            None if self.imbalance is None else float(self.imbalance[index]),
            {
                name: float(values[index])
                for name, values in self.measured.items()
                if np.isfinite(values[index])
            },
        )

    def contacts(self, index: int) -> Contacts:
        """Contacts of one attempt."""
        k = int(self.n_contacts[index])
        return Contacts(
            self.positions[index, :k].copy(),
            self.normals_inward[index, :k].copy(),
            self.friction[index, :k].copy(),
            self.links[index, :k].astype(np.intp),
        )


@dataclass(frozen=True, eq=False)
class Postures:
    """Hands at given motor angles, for B postures of F fingers, in the object's frame.

    Attributes
    ----------
    joints : (B, J) array [rad]
    points : (B, F, 1 + I, 3) array [m]
        The point of each finger's outermost (0) and inner links nearest to the object; a finger
        of one link has it as both.
    inner_touches : (B, F, I) bool array
        Whether an inner link was stopped by the object (breakaway).
    """

    joints: Array
    points: Array
    inner_touches: NDArray[np.bool_]


class GraspEvaluator(Protocol):
    """Closes the hand at palm poses, for one object and friction."""

    @property
    def friction(self) -> Friction:
        """Friction of the pairs of hand link and object."""
        ...

    @property
    def n_attempts(self) -> int:
        """Grasp attempts so far: hands closed or found in collision."""
        ...

    def attempt(self, T_object_palm: Array, preshape: Array) -> Attempts:
        """Close the hand at poses (B, 4, 4) with pre-shapes (B, S)."""
        ...

    def clear_palm(
        self, T_object_palm: Array, normals_outward: Array, preshape: Array, standoff: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Move open hands along the normals until they are free of the object.

        Poses (B, 4, 4) at lambda = 0, normals (B, 3), pre-shapes (B, S), extra distances (B,)
        [m] to go back; returns the moved poses and which of them are free (B,).
        """
        ...


@runtime_checkable
class PostureEvaluator(GraspEvaluator, Protocol):
    """An evaluator that also takes whole postures: ADMM-CP-Opt and rivals need it."""

    @property
    def n_states(self) -> int:
        """States whose guided potential was asked for so far."""
        ...

    def postures(self, T_object_palm: Array, motors: Array) -> Postures:
        """Hands at poses (B, 4, 4) and motor angles (B, S + F) [pre-shape, fingers]."""
        ...

    def attempt_from(self, T_object_palm: Array, joints: Array) -> Attempts:
        """Close the hand at poses (B, 4, 4) from postures (B, J) [rad]."""
        ...

    def approach(
        self, T_object_palm: Array, joints: Array, reach: float
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Move free hands (B, 4, 4), (B, J) along the palm's axis until they touch, at most reach.

        Returns the poses (B, 4, 4) and whether the palm touches there (B,).
        """
        ...

    def guided_potential(self, T_object_palm: Array, joints: Array) -> Array:
        """Guided potential quality energies (B,) of states; inf where the hand collides."""
        ...
