"""A measure: one figure of a grasp, as a function of what a grasp is.

A new one is one module that makes a `Measure`, and one test; `docs/extending.md` shows one whole.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.quality.figures import Figure
from gpis_grasp_planner.quality.wrench_space import contact_wrenches

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class HeldPart:
    """What a measure may look at: contacts, part and hand, in the part's frame.

    Attributes
    ----------
    contacts : Contacts
    center_of_mass : (3,) array [m]
    torque_scale : float [m]
        Torques are divided by it: the largest distance of the part's surface from its centre of
        mass.
    cone_edges : int
        Of a contact's friction pyramid.
    T_object_palm : (4, 4) array
        Palm to part.
    joints : (J,) array [rad]
        The closed hand.
    """

    contacts: Contacts
    center_of_mass: Array
    torque_scale: float
    cone_edges: int
    T_object_palm: Array
    joints: Array

    @functools.cached_property
    def wrenches(self) -> Array:
        """Wrenches ``[force; torque / torque_scale]`` of all pyramid edges, (k * cone_edges, 6)."""
        return contact_wrenches(
            self.contacts, self.center_of_mass, self.torque_scale, self.cone_edges
        )


@dataclass(frozen=True)
class Measure:
    """A figure and how it is computed.

    Attributes
    ----------
    figure : Figure
    of : callable
        `HeldPart` with at least one contact -> float, finite. Called for grasps with force closure.
    """

    figure: Figure
    of: Callable[[HeldPart], float]
