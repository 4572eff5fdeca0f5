"""Distances between batches of model features, and which of them a Matern kernel may be built on.

The paper (section III, below the kernel) measures the distance of two palm poses as

    Delta_T = |t1 - t2| + |log(R1^T R2)|_F / sqrt(2),

translation plus geodesic angle. Matern 5/2 of that distance is **not** a covariance function:
over random poses its matrix has clearly negative eigenvalues once the length scale nears 1 rad
(the geodesic distance of SO(3) has no isometric embedding in a Euclidean space).

The default here is therefore :class:`PoseDistance`, the Euclidean norm of an explicit embedding,

    d^2 = |t1 - t2|^2 / l_t^2 + |R1 - R2|_F^2 / (2 l_r^2),    |R1 - R2|_F / sqrt(2) = 2 |sin(a/2)|,

where a is the geodesic angle. Matern 5/2 of a Euclidean norm is positive definite in every
dimension (it is a scale mixture of Gaussians, Schoenberg 1938), hence also on the image of
R^3 x SO(3) in R^12, and strictly so for distinct poses because the embedding is one to one. It
agrees with the geodesic angle up to a^3/24, so that the length scale l_r keeps its meaning in
radians, and q and -q are one rotation by construction. The paper's own distance stays selectable
as :class:`GeodesicSumDistance`; it says ``definite = False``, and the Gaussian process then
projects the eigenvalues (see :mod:`.factorisation`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.errors import RequestError

Array = NDArray[np.float64]


class Distance(Protocol):
    """A distance on features with one length scale per group of features.

    Attributes
    ----------
    n_features, n_scales : int
    definite : bool
        Whether Matern 5/2 of this distance is proven positive semi-definite.
    scale_bounds : (n_scales, 2) array
        Bounds of the length scales, in the units of the features.
    """

    n_features: int
    n_scales: int
    definite: bool
    scale_bounds: Array

    def matrix(self, A: Array, B: Array, scales: Array) -> Array:
        """Distances (n, m), divided by the length scales, of features (n, p) and (m, p)."""
        ...

    def parts(self, A: Array) -> Array:
        """What the gradient needs of features (n, p) at any length scale: (n_scales, n, n)."""
        ...

    def slopes(self, parts: Array, scales: Array) -> tuple[Array, Array]:
        """Distance d (n, n) and -d times its derivative by each log scale (n_scales, n, n)."""
        ...


class EuclideanDistance:
    """Norm of scaled differences, one length scale per group of features. Definite.

    Parameters
    ----------
    groups : sequence of int
        For each feature the index of its length scale: ``[0] * p`` is isotropic, ``range(p)``
        gives every feature its own (automatic relevance determination).
    scale_bounds : (2,) or (n_scales, 2) array_like
        Lower and upper bound of the length scales, in the units of the features.
    """

    definite = True

    def __init__(self, groups: Sequence[int], scale_bounds: ArrayLike = (0.05, 5.0)):
        self.groups = np.asarray(groups, dtype=int)
        self.n_features = len(self.groups)
        self.n_scales = int(self.groups.max(initial=-1)) + 1
        if self.n_features == 0 or set(self.groups.tolist()) != set(range(self.n_scales)):
            raise RequestError(
                f"Feature groups are {list(groups)}; give one group index per feature, "
                "counting from 0 without a gap."
            )
        self.scale_bounds = checked_bounds(scale_bounds, self.n_scales)

    def matrix(self, A: Array, B: Array, scales: Array) -> Array:
        """Scaled distances (n, m); one matrix product and one pass."""
        weights = 1.0 / scales[self.groups]
        return np.sqrt(_squared(A * weights, B * weights))

    def parts(self, A: Array) -> Array:
        """Squared distances by group (n_scales, n, n)."""
        return np.stack(
            [_squared(A[:, self.groups == g], A[:, self.groups == g]) for g in range(self.n_scales)]
        )

    def slopes(self, parts: Array, scales: Array) -> tuple[Array, Array]:
        """Distance, and the scaled squared parts: -d dd/dlog l_g = s_g / l_g^2."""
        scaled = parts / (scales**2)[:, None, None]
        return np.sqrt(scaled.sum(axis=0)), scaled


class PoseDistance(EuclideanDistance):
    """Distance of poses in R^3 x SO(3) by translation and rotation matrix. Definite.

    Works on the features of :func:`pose_features`: length scale 0 is the translation's [m],
    length scale 1 the rotation's [rad, see the module's text].

    Parameters
    ----------
    translation_bounds : (2,) array_like
        Bounds of the translation's length scale [m].
    rotation_bounds : (2,) array_like
        Bounds of the rotation's length scale [rad].
    """

    def __init__(
        self,
        translation_bounds: ArrayLike = (0.01, 1.0),
        rotation_bounds: ArrayLike = (0.1, 5.0),
    ):
        bounds = np.stack([np.asarray(translation_bounds), np.asarray(rotation_bounds)])
        super().__init__([0] * 3 + [1] * 9, bounds)


class GeodesicSumDistance:
    """The paper's distance: |t1 - t2| / l_t + angle / l_r. Not definite.

    Works on the features of :func:`pose_features`, with the parameters of :class:`PoseDistance`.
    With l_t = l_r = rho it is Delta_T / rho as printed.
    """

    definite = False
    n_features = 12
    n_scales = 2

    def __init__(
        self,
        translation_bounds: ArrayLike = (0.01, 1.0),
        rotation_bounds: ArrayLike = (0.1, 5.0),
    ):
        bounds = np.stack([np.asarray(translation_bounds), np.asarray(rotation_bounds)])
        self.scale_bounds = checked_bounds(bounds, 2)

    def matrix(self, A: Array, B: Array, scales: Array) -> Array:
        """Scaled distances (n, m)."""
        translation = np.sqrt(_squared(A[:, :3], B[:, :3]))
        return translation / scales[0] + _angle(A[:, 3:], B[:, 3:]) / scales[1]

    def parts(self, A: Array) -> Array:
        """Translation distance [m] and geodesic angle [rad] (2, n, n)."""
        return np.stack([np.sqrt(_squared(A[:, :3], A[:, :3])), _angle(A[:, 3:], A[:, 3:])])

    def slopes(self, parts: Array, scales: Array) -> tuple[Array, Array]:
        """Distance, and -d dd/dlog l_g = d part_g / l_g."""
        scaled = parts / scales[:, None, None]
        distance = scaled.sum(axis=0)
        return distance, distance * scaled


def pose_features(translation: ArrayLike, quat_xyzw: ArrayLike) -> Array:
    """Embed poses in R^12: translation [m], and the rotation matrix by rows over sqrt(2).

    Parameters
    ----------
    translation : (n, 3) array_like
    quat_xyzw : (n, 4) array_like
        Quaternions of any length but zero; q and -q give the same features.

    Returns
    -------
    (n, 12) array
    """
    translation = np.atleast_2d(np.asarray(translation, dtype=float))
    rotation = Rotation.from_quat(np.atleast_2d(np.asarray(quat_xyzw, dtype=float))).as_matrix()
    return matrix_features(translation, rotation)


def matrix_features(translation: Array, rotation: Array) -> Array:
    """:func:`pose_features` of translations (n, 3) and rotation matrices (n, 3, 3)."""
    return np.hstack([translation, rotation.reshape(-1, 9) / np.sqrt(2.0)])


def checked_bounds(bounds: ArrayLike, n_scales: int) -> Array:
    """Length scale bounds as (n_scales, 2), or RequestError if they are not 0 < low <= high."""
    array = np.array(np.broadcast_to(np.asarray(bounds, dtype=float), (n_scales, 2)))
    if not (
        np.all(np.isfinite(array)) and np.all(array > 0) and np.all(array[:, 0] <= array[:, 1])
    ):
        raise RequestError(
            f"Length scale bounds are {array.tolist()}; each pair must be 0 < low <= high."
        )
    return array


def _squared(A: Array, B: Array) -> Array:
    # |a|^2 - 2 a.b + |b|^2 in one product. The cancellation leaves about 1e-16 |a|^2, a distance
    # of 1e-8 at most, far below every length scale in use.
    squared = A @ (-2.0 * B.T)
    squared += np.einsum("ij,ij->i", A, A)[:, None]
    squared += np.einsum("ij,ij->i", B, B)
    return np.maximum(squared, 0.0, out=squared)


def _angle(A: Array, B: Array) -> Array:
    chord = np.sqrt(_squared(A, B))
    return 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))
