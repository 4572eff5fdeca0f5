"""What a grasp must respect beside the part itself, as objects that a search can ask.

A constraint answers twice. Before the hand closes it says quickly which hands at their start
are allowed at all (`allows`), so that no closing is wasted on them; after the closing it says
which grasps are blocked, by what, and how far the hand had to move (`verdict`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.evaluator import Attempts
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.hand_motion import HandMotions, hand_motions
from gpis_grasp_planner.grasp.open_hand import pregrasp_of
from gpis_grasp_planner.hand.description import HandDescription

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ClosedHands:
    """B finished attempts with the way to them, in the object's frame.

    Attributes
    ----------
    hand : HandDescription
    T_object_palm : (B, 4, 4) array
    start_joints, joints : (B, J) arrays [rad]
        Where the closing began, and where it ended.
    n_contacts : (B,) int array
    positions : (B, K, 3) array [m]
        Contacts; rows beyond `n_contacts` are not set.
    retreat_m : float [m]
        Length of the approach, along the palm's z.
    """

    hand: HandDescription
    T_object_palm: Array
    start_joints: Array
    joints: Array
    n_contacts: NDArray[np.int64]
    positions: Array
    retreat_m: float

    def __len__(self) -> int:
        return len(self.joints)

    @classmethod
    def of(
        cls, hand: HandDescription, attempts: Attempts, rows: NDArray[np.intp], retreat_m: float
    ) -> ClosedHands:
        """The given rows of attempts."""
        return cls(
            hand,
            attempts.T_object_palm[rows],
            pregrasp_of(attempts, rows, hand),
            attempts.joints[rows],
            attempts.n_contacts[rows],
            attempts.positions[rows],
            retreat_m,
        )

    @classmethod
    def of_grasps(cls, hand: HandDescription, grasps: Sequence[Grasp]) -> ClosedHands:
        """Finished grasps, at least one, as they will be executed."""
        n_contacts = np.array([len(grasp.contacts) for grasp in grasps])
        positions = np.zeros((len(grasps), int(n_contacts.max()), 3))
        for row, grasp in enumerate(grasps):
            positions[row, : len(grasp.contacts)] = grasp.contacts.positions
        return cls(
            hand,
            np.stack([grasp.T_object_palm for grasp in grasps]),
            np.stack([grasp.pregrasp_joints for grasp in grasps]),
            np.stack([grasp.joints for grasp in grasps]),
            n_contacts,
            positions,
            grasps[0].approach_distance,
        )

    def only(self, rows: NDArray[np.bool_]) -> ClosedHands:
        """Those of the given rows (B,), with the motions that were made of them."""
        part = ClosedHands(
            self.hand,
            self.T_object_palm[rows],
            self.start_joints[rows],
            self.joints[rows],
            self.n_contacts[rows],
            self.positions[rows],
            self.retreat_m,
        )
        if (made := self.__dict__.get("motions")) is not None:
            part.__dict__["motions"] = HandMotions(
                made.T[rows], made.moves[rows], made.back[rows], made.bow[rows]
            )
        return part

    @cached_property
    def motions(self) -> HandMotions:
        """Approach and closing as straight moves; made once for all constraints."""
        return hand_motions(
            self.hand,
            self.T_object_palm,
            self.start_joints,
            self.joints,
            -self.retreat_m * self.T_object_palm[:, :3, 2],
        )


@dataclass(frozen=True, eq=False)
class Verdict:
    """What a constraint says of B closed hands.

    Attributes
    ----------
    cause : (B,) array of str or None
        None where the grasp is allowed.
    shift : (B, 3) array [m]
        The smallest translation of the hand, in the object's frame, that frees the same motion;
        zero where it is free already or no such translation is known.
    """

    cause: NDArray[np.object_]
    shift: Array

    @property
    def blocked(self) -> NDArray[np.bool_]:
        """Which hands have a cause (B,)."""
        return np.array([cause is not None for cause in self.cause], dtype=np.bool_)

    @classmethod
    def clear(cls, n: int) -> Verdict:
        """A verdict that allows all of n hands."""
        return cls(np.full(n, None, dtype=object), np.zeros((n, 3)))


@runtime_checkable
class Constraint(Protocol):
    """One thing that grasps must respect, for one part, hand and place.

    `name` and `verdict` are needed. The others have a default that is true of every constraint;
    with answers of their own the search loses no time on hands that are forbidden.
    """

    @property
    def name(self) -> str:
        """What it is called in counts and messages."""
        ...

    @property
    def approach_axis(self) -> Array | None:
        """Direction (3,) in the object's frame in which hands most likely may come, if any."""
        return None

    def allows(self, T_object_palm: Array, joints: Array, /) -> NDArray[np.bool_]:
        """Which hands (B, 4, 4) in start postures (B, J) may approach and begin to close: (B,).

        False only where `verdict` blocks whatever grasp the closing ends in.
        """
        del joints
        return np.ones(len(T_object_palm), dtype=np.bool_)

    def allows_palm(self, T_object_palm: Array, joints: Array, /) -> NDArray[np.bool_]:
        """Which hands (B, 4, 4) may be there at all, however far their fingers are closed: (B,).

        Looks at the links that the closing does not move, with the pre-shape of `joints` (B, J).
        """
        del joints
        return np.ones(len(T_object_palm), dtype=np.bool_)

    def nearest(self, T_object_palm: Array, joints: Array, /) -> Array:
        """The hands moved to the nearest pose that is allowed (B, 4, 4), where one is known.

        Hands that are there already, and those that it knows nothing for, stay where they are.
        """
        del joints
        return np.array(T_object_palm, dtype=float)

    def verdict(self, closed: ClosedHands) -> Verdict:
        """Which closed hands are blocked, and by what; exact up to the constraint's margin."""
        ...


def allowed(
    constraints: tuple[Constraint, ...], T_object_palm: Array, joints: Array
) -> NDArray[np.bool_]:
    """Which hands (B, 4, 4), (B, J) every constraint allows (B,)."""
    free = np.ones(len(T_object_palm), dtype=np.bool_)
    for constraint in constraints:
        free[free] = constraint.allows(T_object_palm[free], joints[free])
    return free
