"""Search domains: where points are drawn, and what the model sees of them.

The optimiser moves in search coordinates x (a box, some of them angles that wrap around); the
Gaussian process sees the features of x, over which its distance is defined. For a textbook
function the features are the coordinates scaled to [0, 1]; for a palm pose they are the embedded
translation and rotation, so that two coordinate triples of one rotation are one point.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.optimise.distances import Distance, EuclideanDistance

Array = NDArray[np.float64]


class Domain(Protocol):
    """What the optimiser needs of a domain.

    Attributes
    ----------
    dim : int
        Number of search coordinates.
    lower, upper : (dim,) arrays
        Their bounds.
    periodic : (dim,) array of bool
        Which of them wrap around.
    distance : Distance
        Distance over the features.
    """

    dim: int
    lower: Array
    upper: Array
    periodic: NDArray[np.bool_]
    distance: Distance

    def sample(self, n: int, rng: np.random.Generator) -> Array:
        """Latin hypercube of n points (n, dim)."""
        ...

    def clip(self, X: Array) -> Array:
        """The points (n, dim) moved into the domain."""
        ...

    def perturb(self, X: Array, radius: Array, rng: np.random.Generator) -> Array:
        """Random neighbours (n, dim) of points (n, dim) at relative radii (n,)."""
        ...

    def features(self, X: Array) -> Array:
        """Model features (n, p) of points (n, dim)."""
        ...


def latin_hypercube(n: int, dim: int, rng: np.random.Generator) -> Array:
    """Points (n, dim) in the unit cube, each coordinate in another n-th of [0, 1].

    The numbers of ``scipy.stats.qmc.LatinHypercube``, whose import takes half a second; like it,
    from a generator spawned by `rng`.
    """
    [rng] = rng.spawn(1)
    within = rng.uniform(size=(n, dim))
    strata = np.tile(np.arange(1, n + 1), (dim, 1))
    for row in strata:
        rng.shuffle(row)
    return np.asarray((strata.T - within) / n)


class BoxDomain:
    """A box, with features of one's choice.

    Parameters
    ----------
    lower, upper : (dim,) array_like
    periodic : (dim,) array_like of bool, optional
        Coordinates that wrap around from upper to lower.
    features : callable, optional
        (n, dim) -> (n, p). Default: the coordinates scaled to [0, 1], a periodic one as a point
        on the circle of circumference one.
    distance : Distance, optional
        Required with `features`. Default: Euclidean, one length scale per coordinate.
    """

    def __init__(
        self,
        lower: ArrayLike,
        upper: ArrayLike,
        periodic: ArrayLike | None = None,
        features: Callable[[Array], Array] | None = None,
        distance: Distance | None = None,
    ):
        self.lower = np.atleast_1d(np.asarray(lower, dtype=float))
        self.upper = np.atleast_1d(np.asarray(upper, dtype=float))
        self.dim = len(self.lower)
        if self.lower.shape != self.upper.shape or not np.all(self.lower < self.upper):
            raise RequestError(
                f"Box from {self.lower.tolist()} to {self.upper.tolist()}; every lower bound "
                "must be below its upper bound."
            )
        if features is not None and distance is None:
            raise RequestError("Features of one's own need a distance over them; give both.")
        self.periodic = np.zeros(self.dim, dtype=bool)
        if periodic is not None:
            self.periodic = np.asarray(periodic, dtype=bool)
        self._features = features
        if distance is None:
            groups = list(range(self.dim)) + np.flatnonzero(self.periodic).tolist()
            distance = EuclideanDistance(groups)
        self.distance: Distance = distance

    @property
    def width(self) -> Array:
        """Extent of the box (dim,)."""
        return self.upper - self.lower

    def sample(self, n: int, rng: np.random.Generator) -> Array:
        """Latin hypercube of n points (n, dim)."""
        return self.lower + self.width * latin_hypercube(n, self.dim, rng)

    def clip(self, X: Array) -> Array:
        """Wrap periodic coordinates, cut the others at the bounds."""
        X = np.asarray(X, dtype=float)
        wrapped = self.lower + np.mod(X - self.lower, self.width)
        return np.where(self.periodic, wrapped, np.clip(X, self.lower, self.upper))

    def perturb(self, X: Array, radius: Array, rng: np.random.Generator) -> Array:
        """Gaussian steps of `radius` times the width, in a random subset of the coordinates.

        Subsets matter where few coordinates are off: a step in all of them would undo the rest.
        """
        n = len(X)
        moved = rng.random((n, self.dim)) < rng.choice([0.35, 1.0], size=(n, 1))
        moved[np.arange(n), rng.integers(self.dim, size=n)] = True
        step = rng.standard_normal((n, self.dim)) * moved
        return self.clip(X + step * self.width * np.asarray(radius)[:, None])

    def features(self, X: Array) -> Array:
        """Model features (n, p)."""
        X = np.asarray(X, dtype=float)
        if self._features is not None:
            return self._features(X)
        unit = (X - self.lower) / self.width
        if not self.periodic.any():
            return unit
        angle = 2.0 * np.pi * unit[:, self.periodic]
        unit[:, self.periodic] = np.cos(angle) / (2.0 * np.pi)
        return np.hstack([unit, np.sin(angle) / (2.0 * np.pi)])
