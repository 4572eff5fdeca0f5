"""Where in space hands were lost: some palms of every cause, thinned evenly over the search.

All of them would be hundreds of thousands; a picture needs some. Which are kept depends on nothing
but their order, so that a search that is repeated gives the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.grasp.funnel import Step

Array = NDArray[np.float64]

MOST_OF_A_CAUSE = 64


@dataclass(frozen=True, eq=False)
class LostPalms:
    """Origins of palm frames of hands that were lost, some of each cause.

    Attributes
    ----------
    positions : mapping of (Step, cause) to (n, 3) array [m]
        In the object's frame, in the order of the search; at most :data:`MOST_OF_A_CAUSE`.
    """

    positions: Mapping[tuple[Step, str], Array] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.positions)


class EvenSample:
    """At most `most` rows of a stream of unknown length: every first, then every second, ...

    Parameters
    ----------
    most : int
        Between a half of it and all of it are kept once so many have come.

    Attributes
    ----------
    rows : (n, 3) array
        What is kept.
    """

    def __init__(self, most: int = MOST_OF_A_CAUSE) -> None:
        self._most = most
        self._stride = 1
        self._n_seen = 0
        self.rows: Array = np.empty((0, 3))

    def add(self, rows: ArrayLike) -> None:
        """Take the next rows (n, 3)."""
        rows = np.asarray(rows, dtype=float).reshape(-1, 3)
        first = -self._n_seen % self._stride
        self._n_seen += len(rows)
        self.rows = np.concatenate([self.rows, rows[first :: self._stride]])
        while len(self.rows) > self._most:
            self.rows = self.rows[::2].copy()
            self._stride *= 2
