"""Hold probabilities that were estimated, for the next estimate of the same pose.

A grasp is fixed to its part, so that its probability depends on the covariance and not on the pose.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Hashable

from numpy import float64
from numpy.typing import NDArray

from gpis_grasp_planner.surroundings.covariance import nearly_equal

_MOST = 2000


class KeptHolds:
    """The last estimates; may be used from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: OrderedDict[Hashable, tuple[NDArray[float64], float]] = OrderedDict()

    def get(self, key: Hashable, covariance: NDArray[float64]) -> float | None:
        """The probability that was estimated under nearly this covariance, None without one.

        Parameters
        ----------
        key : hashable
            Stands for the grasp and all else that decides its probability.
        covariance : (6, 6) array
            In the object's axes.
        """
        with self._lock:
            then, probability = self._kept.get(key, (None, None))
            if then is None or not nearly_equal(then, covariance):
                return None
            self._kept.move_to_end(key)
            return probability

    def put(self, key: Hashable, covariance: NDArray[float64], probability: float) -> None:
        """Keep an estimate in place of the grasp's former one; the least recently used goes."""
        with self._lock:
            self._kept[key] = covariance, probability
            self._kept.move_to_end(key)
            if len(self._kept) > _MOST:
                self._kept.popitem(last=False)
