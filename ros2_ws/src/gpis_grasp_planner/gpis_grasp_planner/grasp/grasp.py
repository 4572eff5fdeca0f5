"""A grasp as the planner answers it: palm, fingers, and the evidence of its quality."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.arm_motion import ArmMotion
from gpis_grasp_planner.grasp.trials import HoldEstimate, Trials
from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.quality.figures import Quality
from gpis_grasp_planner.quality.wrench_space import grasp_quality

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Grasp:
    """A closed hand on the object, in the object's frame.

    Attributes
    ----------
    T_object_palm : (4, 4) array
        Pose of the palm frame.
    joints : (J,) array [rad]
        The closed hand.
    pregrasp_joints : (J,) array [rad]
        The open hand from which it closes.
    contacts : Contacts
    quality : Quality
        Epsilon, volume and every other figure that is known of it.
    approach_direction : (3,) array
        Unit vector along which the palm comes (its z axis).
    approach_distance : float [m]
        The open hand is known to be free this far back along it.
    trials : Trials or None
        What physics said; None where the grasp was not tried.
    hold_probability : float or None
        Under the covariance of a pose estimate; None where none was given.
    lift_direction : (3,) array or None
        Unit vector away from the support that the part lies on; None where none is known.
    hold_estimate : HoldEstimate or None
        By trials in physics; None where none were asked for.
    arm : ArmMotion or None
        How the arm brings the hand there and lifts it; None where no arm was given.
    """

    T_object_palm: Array
    joints: Array
    pregrasp_joints: Array
    contacts: Contacts
    quality: Quality
    approach_direction: Array
    approach_distance: float
    trials: Trials | None = None
    hold_probability: float | None = None
    lift_direction: Array | None = None
    hold_estimate: HoldEstimate | None = None
    arm: ArmMotion | None = None

    @property
    def way_out(self) -> Array:
        """Unit vector to lift along: away from the support, else back against the approach."""
        return -self.approach_direction if self.lift_direction is None else self.lift_direction

    @property
    def epsilon(self) -> float:
        """-1 without force closure."""
        return self.quality.epsilon

    @property
    def volume(self) -> float:
        """Of the grasp wrench space."""
        return self.quality.volume

    @property
    def imbalance(self) -> float | None:
        """What the closing hand leaves unbalanced; None where nobody asked."""
        return self.quality.imbalance

    @property
    def feasible(self) -> bool:
        """Whether the grasp has force closure."""
        return self.quality.force_closure

    def recomputed_quality(
        self, center_of_mass: Array, torque_scale: float, cone_edges: int
    ) -> Quality:
        """Epsilon and volume from the contacts alone, by the full hull."""
        return grasp_quality(self.contacts, center_of_mass, torque_scale, cone_edges)
