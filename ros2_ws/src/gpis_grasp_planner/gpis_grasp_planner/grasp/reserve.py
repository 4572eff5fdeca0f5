"""Further grasps kept beside an answer, for when some of the answer are blocked or do not hold.

The answer is ten or twenty grasps far apart from each other; on a table more than half of them
may come from below. The reserve holds up to 150 more, nearer together, which cost nothing until
they are needed: their exact quality is computed when one is promoted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.grasp.grasp import Grasp

Array = NDArray[np.float64]


class LateGrasps(Sequence[Grasp]):
    """Grasps that are read when one of them is asked for.

    Parameters
    ----------
    read : callable
        Reads all of them; it can be pickled, and so can what it gives.
    """

    def __init__(self, read: Callable[[], tuple[Grasp, ...]]) -> None:
        self._read = read
        self._grasps: tuple[Grasp, ...] | None = None

    @property
    def _all(self) -> tuple[Grasp, ...]:
        if self._grasps is None:
            self._grasps = self._read()
        return self._grasps

    def __len__(self) -> int:
        return len(self._all)

    @overload
    def __getitem__(self, index: int) -> Grasp: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Grasp, ...]: ...
    def __getitem__(self, index: Any) -> Any:
        return self._all[index]

    def __iter__(self) -> Iterator[Grasp]:
        return iter(self._all)


@dataclass(frozen=True, eq=False)
class Reserve:
    """Grasps with the search's estimate of their quality, best first, and what makes it exact.

    Attributes
    ----------
    estimates : sequence of Grasp
        Epsilon may be an upper bound, volume an estimate.
    center_of_mass : (3,) array [m]
    torque_scale : float [m]
    cone_edges : int
    """

    estimates: Sequence[Grasp] = ()
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
