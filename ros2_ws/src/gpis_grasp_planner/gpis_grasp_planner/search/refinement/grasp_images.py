"""Images of good grasps under the symmetries that the part nearly has.

A part that is turned, or has a plane of symmetry, has every good grasp more than once. Instead of
searching for it again the palm is reflected or turned with the part and the hand closed there, on
the part as it is: where the symmetry is not quite one, the image is a start for the refinement or
no grasp at all. A reflection takes a hand that is its own mirror image; others are turned only.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.hand.mirror import hand_mirror
from gpis_grasp_planner.search.hand_fitting import HandFitting
from gpis_grasp_planner.surface.near_symmetry import near_symmetries

if TYPE_CHECKING:
    from gpis_grasp_planner.search.context import PlanningContext

Array = NDArray[np.float64]

_LISTED = 20
_ALIKE = 5  # decimals of metres and of the rotation's entries


class GraspImages:
    """Tries the images of the best distinct grasps, each grasp once.

    An image has none of its own until it has been refined: the symmetries are near ones, and
    images of images would drift about what they are images of.

    Parameters
    ----------
    context : PlanningContext
        Its archive gives the grasps and takes what is found.
    """

    def __init__(self, context: PlanningContext):
        self._context = context
        self._settings = context.settings.refinement
        self._known: set[bytes] = set()
        self._fitting = HandFitting(context)

    def step(self) -> bool:
        """Try the images of the best listed grasp that has none; False if there is none."""
        if not len(self._left):
            return False
        context = self._context
        for grasp in context.archive.best(_LISTED):
            own = _key(grasp.T_object_palm)
            if own in self._known:
                continue
            self._known.add(own)
            T = self._left @ grasp.T_object_palm @ self._right
            T = T[[_key(image) not in self._known for image in T]]
            if len(T):
                self._known.update(_key(image) for image in T)
                preshape = np.tile(grasp.preshape, (len(T), 1))
                context.archive.add(self._fitting.attempt(T, preshape))
                return True
        return False

    @property
    def _left(self) -> Array:
        return self._maps[0]

    @property
    def _right(self) -> Array:
        return self._maps[1]

    @cached_property
    def _maps(self) -> tuple[Array, Array]:
        """Factors (n, 4, 4) left and right of a palm's pose; found at the first use."""
        context = self._context
        mirror = hand_mirror(context.hand)
        maps = [
            (symmetry.T_image_object, mirror if symmetry.is_reflection else np.eye(4))
            for symmetry in near_symmetries(
                context.atlas,
                context.part.center_of_mass,
                context.max_radius,
                self._settings.image_tolerance,
            )
        ]
        usable = [(left, right) for left, right in maps if right is not None]
        left = np.array([m[0] for m in usable]).reshape(-1, 4, 4)
        return left, np.array([m[1] for m in usable]).reshape(-1, 4, 4)


def _key(T: Array) -> bytes:
    """The same for poses (4, 4) that differ by rounding errors only."""
    return (np.round(T[:3], _ALIKE) + 0.0).tobytes()
