"""How far a part on its support goes while the hand closes: nothing but friction holds it there.

The strict protocol holds the part while the fingers close, as what a part rests on cannot be known.
Where it is known, the part lies free on a plane under gravity, and fingers that arrive one after
the other push it along until they oppose each other.
"""

from __future__ import annotations

from functools import reduce

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.transforms import inverse, transform
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.verification.motion import NO_MOTION, Motion
from gpis_grasp_planner.verification.protocol import Verifier
from gpis_grasp_planner.verification.table_lift import GRAVITY_M_S2
from gpis_grasp_planner.verification.trial_world import TrialWorld

Array = NDArray[np.float64]

_SETTLING_S = 0.1


def closing_motion(
    verifier: Verifier, grasp: Grasp, point: Array, up: Array, friction: float
) -> Motion | None:
    """How far the part goes until all fingers press, at most; None where they do not in time.

    Of several engines the largest. Bullet's plane meets the pieces of the part alone: there the
    verifier has to cover the whole part.

    Parameters
    ----------
    verifier : Verifier
        Entered, of the part; its settings have the part's mass and its friction to the hand.
    grasp : Grasp
    point, up : (3,) arrays
        The plane, in the part's frame.
    friction : float
        Between part and plane.
    """
    motions = [_motion_in(world, verifier, grasp, point, up, friction) for world in verifier.worlds]
    found = [motion for motion in motions if motion is not None]
    if len(found) < len(motions):
        return None
    return reduce(Motion.larger, found, NO_MOTION)


def _motion_in(
    world: TrialWorld, verifier: Verifier, grasp: Grasp, point: Array, up: Array, friction: float
) -> Motion | None:
    verifier.place_in(world, grasp.T_object_palm, grasp, together=True)
    T_palm_part = inverse(grasp.T_object_palm)
    world.lay_down(T_palm_part @ transform(_upright(up), point), friction)
    gravity = -GRAVITY_M_S2 * T_palm_part[:3, :3] @ up
    before, largest = world.part_pose(), NO_MOTION

    def watch() -> None:
        nonlocal largest
        largest = largest.larger(world.motion_since(before))

    if not world.close(gravity, watch):
        return None
    world.run(_SETTLING_S, gravity)
    watch()
    return largest


def _upright(up: Array) -> Array:
    """A rotation (3, 3) whose z axis is `up`."""
    side = np.cross(up, [1.0, 0.0, 0.0] if abs(up[0]) < 0.9 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    return np.stack([side, np.cross(up, side), up], axis=1)
