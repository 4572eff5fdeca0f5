"""Constraints of users: found by name, made for one plan, and watched while they are asked.

A user's constraint is a callable, such as a class, that makes a `grasp.constraint.Constraint` of a
`Situation`. A distribution registers it by an entry point of the group
``gpis_grasp_planner.constraints``; `docs/extending.md` shows one whole.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.constraint import ClosedHands, Constraint, Verdict
from gpis_grasp_planner.grasp.constraint_settings import ConstraintSettings
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.registered import find, load
from gpis_grasp_planner.surroundings.place import Place

Array = NDArray[np.float64]

GROUP = "gpis_grasp_planner.constraints"
_KIND = "constraint"


@dataclass(frozen=True, eq=False)
class Situation:
    """What a constraint is made of.

    Attributes
    ----------
    hand : HandDescription
    part : Part
    place : Place
        Where the part lies. `Place.around` is what stands there, in the part's frame.
    """

    hand: HandDescription
    part: Part
    place: Place


class OwnConstraint(Constraint):
    """A user's constraint whose answers are checked, so that a wrong one cannot pass in silence.

    Parameters
    ----------
    label : str
        The name in the settings.
    constraint : Constraint
    """

    def __init__(self, label: str, constraint: Constraint):
        self._label = label
        self._constraint = constraint

    @property
    def name(self) -> str:
        """Its own name."""
        return str(self._constraint.name)

    @property
    def approach_axis(self) -> Array | None:
        """Its own, if it has one."""
        axis = self._constraint.approach_axis
        return None if axis is None else self._array("approach_axis", axis, (3,))

    def allows(self, T_object_palm: Array, joints: Array, /) -> NDArray[np.bool_]:
        """Which hands it allows before they close (B,)."""
        return self._mask("allows", self._constraint.allows, T_object_palm, joints)

    def allows_palm(self, T_object_palm: Array, joints: Array, /) -> NDArray[np.bool_]:
        """Which palms it allows (B,)."""
        return self._mask("allows_palm", self._constraint.allows_palm, T_object_palm, joints)

    def nearest(self, T_object_palm: Array, joints: Array, /) -> Array:
        """The nearest allowed hands (B, 4, 4)."""
        moved = self._asked("nearest", self._constraint.nearest, T_object_palm, joints)
        return self._array("nearest", moved, T_object_palm.shape)

    def verdict(self, closed: ClosedHands) -> Verdict:
        """Which closed hands it blocks; a cause is a text."""
        found = self._asked("verdict", self._constraint.verdict, closed)
        n = len(closed)
        if not isinstance(found, Verdict) or np.shape(found.cause) != (n,):
            raise self._wrong("verdict", f"a Verdict of {n} causes", found)
        shift = self._array("verdict", found.shift, (n, 3))
        causes = [None if cause is None else str(cause) or self.name for cause in found.cause]
        return Verdict(np.array(causes, dtype=object), shift)

    def _mask(self, method: str, ask: Callable[..., Any], T: Array, joints: Array) -> Any:
        mask = np.asarray(self._asked(method, ask, T, joints))
        if mask.shape != (len(T),) or mask.dtype != np.bool_:
            raise self._wrong(method, f"{len(T)} truth values", mask)
        return mask

    def _array(self, method: str, value: object, shape: tuple[int, ...]) -> Array:
        try:
            array = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            raise self._wrong(method, f"numbers of shape {shape}", value) from None
        if array.shape != shape or not np.isfinite(array).all():
            raise self._wrong(method, f"finite numbers of shape {shape}", value)
        return array

    def _asked(self, method: str, ask: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return ask(*arguments)
        except Exception as error:  # of a stranger's method
            raise RequestError(
                f"The constraint '{self._label}' raised {error!r} in {method}(). Repair it, or "
                "leave it out of constraints.names."
            ) from error

    def _wrong(self, method: str, wanted: str, got: object) -> RequestError:
        what = f"shape {got.shape}" if isinstance(got, np.ndarray) else type(got).__name__
        return RequestError(
            f"{method}() of the constraint '{self._label}' gave {what}; it must give {wanted}. "
            "Repair it, or leave it out of constraints.names."
        )


def own_constraints(
    hand: HandDescription, part: Part, place: Place, settings: ConstraintSettings
) -> tuple[Constraint, ...]:
    """The constraints of the settings, made for one plan.

    Raises
    ------
    RequestError
        INVALID_SETTING: there is no such constraint, or it cannot be made.
    """
    return tuple(_make(name, Situation(hand, part, place)) for name in settings.names)


def identities(settings: ConstraintSettings) -> dict[str, str]:
    """SHA-256 (hex) of the file of each constraint's module: a changed rule is another one.

    Raises
    ------
    RequestError
        As :func:`own_constraints`.
    """
    return {name: _file_hash(name) for name in settings.names}


def _make(name: str, situation: Situation) -> Constraint:
    make = load(_KIND, point := find(_KIND, GROUP, name))
    if not callable(make):
        raise RequestError(
            f"The constraint '{name}' ({point.value}) is {make!r}; it must be callable with a "
            "Situation, such as a class."
        )
    try:
        made = make(situation)
        complete = isinstance(made.name, str) and callable(made.verdict)
    except Exception as error:  # of a stranger's function
        raise RequestError(
            f"The constraint '{name}' ({point.value}) cannot be made for "
            f"'{situation.part.mesh_id}': {error!r}. Repair it, or leave it out of "
            "constraints.names."
        ) from error
    if not (complete and isinstance(made, Constraint)):
        raise RequestError(
            f"The constraint '{name}' ({point.value}) makes {made!r}; it must be a "
            "grasp.constraint.Constraint with a name and verdict()."
        )
    return OwnConstraint(name, made)


def _file_hash(name: str) -> str:
    point = find(_KIND, GROUP, name)
    load(_KIND, point)
    file = getattr(sys.modules[point.module], "__file__", None)
    return hashlib.sha256(Path(file).read_bytes()).hexdigest() if file else ""
