"""Which observations an exact Gaussian process keeps when there are too many.

Half of the window are the best observations' neighbours, whatever their values, since expected
improvement is decided there; the other half are spread as widely as possible over the features, so
that a region once found poor is not forgotten and searched again. To keep the best ones themselves
would be wrong where observations are noisy: of many tries at one place the lucky ones would stay,
and the model would believe in a place that is only well tried.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

Array = NDArray[np.float64]

_BEST_SHARE = 8


def choose_window(features: Array, targets: Array, size: int) -> NDArray[np.intp]:
    """Indices, ascending, of at most `size` of the observations.

    Parameters
    ----------
    features : (n, p) array
    targets : (n,) array
        Larger is better.
    size : int

    Notes
    -----
    Farthest-point selection; O(size n p), without randomness.
    """
    n = len(targets)
    if n <= size:
        return np.arange(n)
    spread = features.std(axis=0)
    scaled = features / np.where(spread > 0, spread, 1.0)
    best = np.argsort(-targets, kind="stable")[: max(1, size // _BEST_SHARE)]
    from_best = cdist(scaled, scaled[best], "sqeuclidean").min(axis=1)
    chosen = list(np.argsort(from_best, kind="stable")[: max(1, size // 2)])
    nearest = np.full(n, np.inf)
    for index in chosen:
        nearest = np.minimum(nearest, ((scaled - scaled[index]) ** 2).sum(axis=1))
    nearest[chosen] = -1.0
    while len(chosen) < size:
        index = int(np.argmax(nearest))
        chosen.append(index)
        nearest = np.minimum(nearest, ((scaled - scaled[index]) ** 2).sum(axis=1))
        nearest[chosen] = -1.0
    return np.sort(np.asarray(chosen, dtype=np.intp))
