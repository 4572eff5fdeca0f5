"""The palm's search space: two ellipsoids for the position, hyperspherical angles for rotation.

A palm pose has six coordinates (paper, section III.A)::

    [theta_e, phi_e, s, phi, psi, theta]

The first three place the palm's face between the ellipsoid E_1 of the object's box and the
ellipsoid E_2 of the box grown by a clearance: ``t = c_0 + r (a_1 sin theta_e cos phi_e, ...)``
with ``r = 1 + s (r_max - 1)``. The last three are the unit quaternion in hyperspherical
coordinates, phi and psi in [0, pi], theta in [0, 2 pi).

The paper calls both pairs of angles theta and phi, though their ranges differ (theta_e in
[0, pi], phi_e in [0, 2 pi) on the ellipsoid); the suffix e keeps them apart. What lies at t is the
middle of the palm's face, not the palm frame's origin in the flange 79 mm behind it.

More coordinates may follow, the hand's pre-shape (of the Barrett the spread of its fingers) and the
standoff [m]: how far the palm goes back from where it would touch. The paper leaves both to
AutoGrasp and the ladder; but they decide as much about a grasp as the palm's pose, and left to
chance they are noise to the model.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.optimise.distances import EuclideanDistance, matrix_features
from gpis_grasp_planner.optimise.domain import BoxDomain

Array = NDArray[np.float64]

_PALM_UPPER = [np.pi, 2.0 * np.pi, 1.0, np.pi, np.pi, 2.0 * np.pi]
_PALM_PERIODIC = [False, True, False, False, False, True]


def quat_from_hyperspherical(angles: Array) -> Array:
    """Unit quaternions (n, 4) xyzw from (n, 3) angles phi, psi, theta.

    ``w = cos phi, x = sin phi cos psi, y = sin phi sin psi cos theta, z = sin phi sin psi sin
    theta``.
    """
    phi, psi, theta = np.moveaxis(np.asarray(angles, dtype=float), -1, 0)
    w = np.cos(phi)
    x = np.sin(phi) * np.cos(psi)
    y = np.sin(phi) * np.sin(psi) * np.cos(theta)
    z = np.sin(phi) * np.sin(psi) * np.sin(theta)
    return np.stack([x, y, z, w], axis=-1)


def hyperspherical_from_quat(quat_xyzw: Array) -> Array:
    """Angles phi, psi, theta (n, 3) of unit quaternions (n, 4) xyzw; inverse of the above."""
    x, y, z, w = np.moveaxis(np.asarray(quat_xyzw, dtype=float), -1, 0)
    phi = np.arctan2(np.sqrt(x * x + y * y + z * z), w)
    psi = np.arctan2(np.hypot(y, z), x)
    theta = np.mod(np.arctan2(z, y), 2.0 * np.pi)
    # A tiny negative angle is rounded to the full circle itself.
    return np.stack([phi, psi, np.where(theta < 2.0 * np.pi, theta, 0.0)], axis=-1)


class PalmSearchSpace:
    """Coordinates (n, 6) to poses of the palm's face, and the optimiser's domain over them.

    Parameters
    ----------
    bounds : (2, 3) array [m]
        The object's axis-aligned box.
    clearance_m : float
        How far the outer box is beyond the object's on every side.
    adapt : callable, optional
        (n, 4, 4) -> (n, 4, 4), where a local adaption will move proposals. The model then sees
        the adapted pose: two proposals that end at one place are one point to it.
    posture_bounds : (2, p) array_like, optional
        Ends of the pre-shape's motors [rad or m] and of the standoff [m]. Given, they are the
        coordinates from the seventh on.
    """

    def __init__(
        self,
        bounds: Array,
        clearance_m: float,
        adapt: Callable[[Array], Array] | None = None,
        posture_bounds: ArrayLike | None = None,
    ):
        self._adapt = adapt
        self._last: tuple[Array, Array] | None = None
        lower, upper = np.asarray(bounds, dtype=float)
        self.center = 0.5 * (lower + upper)
        # A sheet has no extent along its normal; the ellipsoid needs one.
        self.inner_axes = np.maximum(0.5 * (upper - lower), 1e-3)
        self.outer_axes = self.inner_axes + clearance_m
        diagonal = float(np.linalg.norm(upper - lower))
        scale_bounds = [(0.05 * diagonal, diagonal + clearance_m), (0.2, 3.0)]
        groups = [0] * 3 + [1] * 9
        lower_corner, upper_corner = [0.0] * len(_PALM_UPPER), list(_PALM_UPPER)
        if posture_bounds is not None:
            ends = np.asarray(posture_bounds, dtype=float)
            width = np.maximum(ends[1] - ends[0], 1e-6)
            scale_bounds += [(0.1 * x, 3.0 * x) for x in width.tolist()]
            groups += range(2, 2 + len(width))
            lower_corner += ends[0].tolist()
            upper_corner += (ends[0] + width).tolist()
        n = len(upper_corner)
        self.domain = BoxDomain(
            np.array(lower_corner),
            upper_corner,
            [*_PALM_PERIODIC, *[False] * (n - len(_PALM_PERIODIC))],
            features=self._features,
            distance=EuclideanDistance(groups, np.array(scale_bounds)),
        )

    def positions(self, X: Array) -> Array:
        """Positions (n, 3) [m] of coordinates (n, 6); always between the two ellipsoids."""
        theta_e, phi_e, s = X[:, 0], X[:, 1], X[:, 2]
        direction = np.stack(
            [
                np.sin(theta_e) * np.cos(phi_e),
                np.sin(theta_e) * np.sin(phi_e),
                np.cos(theta_e),
            ],
            axis=1,
        )
        scaled = direction * self.inner_axes / self.outer_axes
        r_max = 1.0 / np.linalg.norm(scaled, axis=1)
        r = 1.0 + s * (r_max - 1.0)
        return np.asarray(self.center + r[:, None] * direction * self.inner_axes)

    def poses(self, X: Array) -> Array:
        """Poses of the palm's face (n, 4, 4) in the object's frame."""
        X = np.atleast_2d(X)
        R = Rotation.from_quat(quat_from_hyperspherical(X[:, 3:6])).as_matrix()
        return transform(R, self.positions(X))

    def coordinates(self, T_object_face: Array) -> Array:
        """Coordinates (n, 6) of poses of the palm's face (n, 4, 4); the inverse of `poses`.

        A position that is not between the two ellipsoids gets the nearest s that is.
        """
        offset = (T_object_face[:, :3, 3] - self.center) / self.inner_axes
        r = np.linalg.norm(offset, axis=1)
        direction = offset / np.maximum(r, 1e-12)[:, None]
        r_max = 1.0 / np.linalg.norm(direction * self.inner_axes / self.outer_axes, axis=1)
        s = np.clip((r - 1.0) / (r_max - 1.0), 0.0, 1.0)
        theta_e = np.arccos(np.clip(direction[:, 2], -1.0, 1.0))
        phi_e = np.mod(np.arctan2(direction[:, 1], direction[:, 0]), 2.0 * np.pi)
        quat = Rotation.from_matrix(T_object_face[:, :3, :3]).as_quat()
        # Both signs are the same rotation; phi of the angles is in [0, pi] either way.
        return np.column_stack([theta_e, phi_e, s, hyperspherical_from_quat(quat)])

    def _features(self, X: Array) -> Array:
        return self._features_at(self.places(X), X[:, 6:])

    def places(self, X: Array) -> Array:
        """What stands for coordinates (n, 6 and more) in the model: adapted poses (n, 4, 4).

        Those of the last call are kept: acquisition asks for the same ones twice.
        """
        if self._last is None or not np.array_equal(self._last[0], X):
            self._last = (np.array(X), self._adapted(self.poses(X)))
        return self._last[1]

    def features_of(self, T_object_face: Array, posture: Array) -> Array:
        """Model features (n, 12 and more) of poses of the palm's face (n, 4, 4) and postures.

        `posture` (n, p) are pre-shape and standoff [m] as the space has them.
        """
        return self._features_at(self._adapted(T_object_face), posture)

    def _adapted(self, T_object_face: Array) -> Array:
        return T_object_face if self._adapt is None else self._adapt(T_object_face)

    def _features_at(self, T: Array, posture: Array) -> Array:
        return np.hstack([matrix_features(T[:, :3, 3], T[:, :3, :3]), posture])
