"""Further grasps kept beside an answer, for when some of the answer are blocked or do not hold.

The answer is ten or twenty grasps far apart from each other; on a table more than half of them
may come from below. The reserve holds up to 150 more, nearer together, which cost nothing until
they are needed: their exact quality is computed when one is promoted.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.grasp import Grasp

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Reserve:
    """Grasps with the search's estimate of their quality, best first, and what makes it exact.

    Attributes
    ----------
    estimates : tuple of Grasp
        Epsilon may be an upper bound, volume an estimate.
    center_of_mass : (3,) array [m]
    torque_scale : float [m]
    cone_edges : int
    """

    estimates: tuple[Grasp, ...] = ()
    center_of_mass: Array = field(default_factory=lambda: np.zeros(3))
    torque_scale: float = 1.0
    cone_edges: int = 8
    _exact: dict[int, Grasp] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self.estimates)

    def exact(self, index: int) -> Grasp:
        """Grasp `index` with its exact quality: 10 to 60 ms the first time."""
        if index not in self._exact:
            grasp = self.estimates[index]
            quality = grasp.recomputed_quality(
                self.center_of_mass, self.torque_scale, self.cone_edges
            )
            self._exact[index] = replace(
                grasp,
                quality=replace(grasp.quality, epsilon=quality.epsilon, volume=quality.volume),
            )
        return self._exact[index]
