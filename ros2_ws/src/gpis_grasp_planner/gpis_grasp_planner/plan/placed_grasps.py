"""Grasps held against the surroundings of one place: which are clear, with what pre-grasp.

A grasp that is blocked on its way only, by its open fingers, may be clear with narrower ones; one
that is clear anyway comes narrow where that stays clear. What is answered, and tried in physics,
is the grasp after this, if the part itself leaves it the way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gpis_grasp_planner.arm.constraint import ArmConstraint
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.grasp.constraint import ClosedHands, Constraint
from gpis_grasp_planner.grasp.funnel import Loss
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.surroundings.clearance import Cause, Clearance, clear_grasps
from gpis_grasp_planner.surroundings.clearance_settings import ClearanceSettings
from gpis_grasp_planner.surroundings.obstacles import Surroundings
from gpis_grasp_planner.surroundings.pregrasp import (
    is_open,
    narrow_pregrasp,
    timed_pregrasp,
)
from gpis_grasp_planner.surroundings.way_past_part import meets_part_on_approach

_ON_THE_WAY = (Cause.PREGRASP, Cause.CLOSING, Cause.APPROACH)


@dataclass(frozen=True, eq=False)
class GraspPlacing:
    """Places grasps of one part; all in the object's frame.

    Attributes
    ----------
    hand : HandDescription
    around : Surroundings
        In the object's frame (`Place.around`).
    settings : ClearanceSettings
    tree : TriangleTree
        Of the part.
    forbidding : tuple of Constraint
        What the request forbids beside the surroundings: directions, regions of the part; the arm.
    arm : ArmConstraint or None
        The one of `forbidding`, which knows its ways.
    own : tuple of Constraint
        Those of `forbidding` that a user added.
    """

    hand: HandDescription
    around: Surroundings
    settings: ClearanceSettings
    tree: TriangleTree
    forbidding: tuple[Constraint, ...] = ()
    arm: ArmConstraint | None = None
    own: tuple[Constraint, ...] = ()

    @property
    def constrained(self) -> bool:
        """Whether there is anything that a grasp may be blocked by."""
        return bool(self.around) or bool(self.forbidding)

    def clear(self, grasps: Sequence[Grasp]) -> tuple[list[Grasp], list[Clearance]]:
        """The grasps, some with a narrower pre-grasp to come free, and the clearance of each.

        About 50 ms for 170 grasps and a plane, some 4 ms for each pre-grasp to be narrowed.
        """
        kept, found = list(grasps), self._clearances(grasps)
        rows = [i for i, clearance in enumerate(found) if clearance.cause in _ON_THE_WAY]
        self._narrow(kept, found, rows)
        return kept, found

    def as_planned(self, grasps: Sequence[Grasp]) -> tuple[list[Grasp], list[Clearance]] | None:
        """Grasps that were finished for a place like this, if all of them are clear as they are.

        With the way to lift them here; some 0.2 ms a grasp.
        """
        found = self._clearances(grasps)
        if not all(clearance.clear for clearance in found):
            return None
        return self._lifted(grasps), found

    def finished(
        self, grasps: Sequence[Grasp], found: Sequence[Clearance]
    ) -> tuple[list[Grasp], list[Clearance]]:
        """Clear grasps with the pre-grasp that is answered, and the way to lift them.

        Without anything around, what is not open any more was finished before and stays. A grasp
        whose pre-grasp meets the part as it comes is not clear.
        """
        kept, clearances = self._with_pregrasps(grasps, found)
        meets = meets_part_on_approach(self.hand, kept, self.tree)
        return kept, [
            replace(clearance, cause=str(Loss.WAY_BACK), nearest="part") if met else clearance
            for clearance, met in zip(clearances, meets, strict=True)
        ]

    def _with_pregrasps(
        self, grasps: Sequence[Grasp], found: Sequence[Clearance]
    ) -> tuple[list[Grasp], list[Clearance]]:
        kept, clearances = list(grasps), list(found)
        if not self.constrained:
            if self.settings.pregrasp == "together":
                rows = [i for i, grasp in enumerate(kept) if is_open(self.hand, grasp)]
                timed = timed_pregrasp(
                    self.hand,
                    [kept[i] for i in rows],
                    self.tree,
                    self.settings.pregrasp_clearance_m,
                )
                for i, grasp in zip(rows, timed, strict=True):
                    kept[i] = grasp
            return self._lifted(kept), clearances
        self._narrow(kept, clearances, list(range(len(kept))))
        return self._lifted(kept), clearances

    def _lifted(self, grasps: Sequence[Grasp]) -> list[Grasp]:
        support = self.around.support
        lift = None if support is None else support.normal
        kept = [
            # One that is planned in free space stays itself.
            grasp if lift is grasp.lift_direction is None else replace(grasp, lift_direction=lift)
            for grasp in grasps
        ]
        return kept if self.arm is None else self.arm.carried(kept)

    def _narrow(self, grasps: list[Grasp], found: list[Clearance], rows: Sequence[int]) -> None:
        """Narrow the pre-grasps of some grasps where that is clear, in place."""
        if self.settings.pregrasp == "open" or not rows:
            return
        left = list(rows)
        for together in (True, False) if self.settings.pregrasp == "together" else (False,):
            narrow = narrow_pregrasp(
                self.hand,
                [grasps[i] for i in left],
                self.tree,
                self.settings.pregrasp_clearance_m,
                together,
            )
            checked = self._clearances(narrow)
            blocked = []
            for i, grasp, clearance in zip(left, narrow, checked, strict=True):
                if clearance.clear:
                    grasps[i], found[i] = grasp, clearance
                else:
                    blocked.append(i)
            left = blocked

    def _clearances(self, grasps: Sequence[Grasp]) -> list[Clearance]:
        """From the surroundings; blocked as well where the request forbids the grasp."""
        if not grasps:
            return []
        found = clear_grasps(self.hand, grasps, self.around, self.settings)
        if not self.forbidding:
            return found
        closed = ClosedHands.of_grasps(self.hand, grasps)
        for constraint in self.forbidding:
            cause = constraint.verdict(closed).cause
            found = [
                replace(clearance, cause=cause[i], nearest=constraint.name)
                if clearance.clear and cause[i] is not None
                else clearance
                for i, clearance in enumerate(found)
            ]
        return found
