"""Point contacts with friction between the hand and the object, in the object's frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import GraspPlannerError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Contacts:
    """k point contacts in the object's frame.

    Attributes
    ----------
    positions : (k, 3) array [m]
    normals_inward : (k, 3) array
        Unit normals into the object: the direction in which the hand can press.
    friction : (k,) array
        Coulomb coefficient of each contact.
    links : (k,) int array
        Index of the hand's touching link.
    """

    positions: Array
    normals_inward: Array
    friction: Array
    links: NDArray[np.intp]

    def __post_init__(self) -> None:
        k = len(self.positions)
        if self.positions.shape != (k, 3) or self.normals_inward.shape != (k, 3):
            raise GraspPlannerError(
                f"Contacts take positions and normals of shape (k, 3); got "
                f"{self.positions.shape} and {self.normals_inward.shape}."
            )
        if len(self.friction) != k or len(self.links) != k:
            raise GraspPlannerError(
                f"{k} contacts take {k} friction coefficients and links; got "
                f"{len(self.friction)} and {len(self.links)}."
            )

    def __len__(self) -> int:
        return len(self.positions)

    @staticmethod
    def none() -> Contacts:
        """No contact at all."""
        return Contacts(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=np.intp))
