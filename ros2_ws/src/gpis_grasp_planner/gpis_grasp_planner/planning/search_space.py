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
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.optimise.distances import PoseDistance, pose_features
from gpis_grasp_planner.optimise.domain import BoxDomain

Array = NDArray[np.float64]

_LOWER = np.zeros(6)
_UPPER = np.array([np.pi, 2.0 * np.pi, 1.0, np.pi, np.pi, 2.0 * np.pi])
_PERIODIC = np.array([False, True, False, False, False, True])


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
    return np.stack([phi, psi, theta], axis=-1)


class PalmSearchSpace:
    """Coordinates (n, 6) to poses of the palm's face, and the optimiser's domain over them.

    Parameters
    ----------
    bounds : (2, 3) array [m]
        The object's axis-aligned box.
    clearance_m : float
        How far the outer box is beyond the object's on every side.
    """

    def __init__(self, bounds: Array, clearance_m: float):
        lower, upper = np.asarray(bounds, dtype=float)
        self.center = 0.5 * (lower + upper)
        # A sheet has no extent along its normal; the ellipsoid needs one.
        self.inner_axes = np.maximum(0.5 * (upper - lower), 1e-3)
        self.outer_axes = self.inner_axes + clearance_m
        diagonal = float(np.linalg.norm(upper - lower))
        self.distance = PoseDistance(
            translation_bounds=(0.05 * diagonal, diagonal + clearance_m),
            rotation_bounds=(0.2, 3.0),
        )
        self.domain = BoxDomain(
            _LOWER, _UPPER, _PERIODIC, features=self._features, distance=self.distance
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
        R = Rotation.from_quat(quat_from_hyperspherical(X[:, 3:])).as_matrix()
        return transform(R, self.positions(X))

    def _features(self, X: Array) -> Array:
        return pose_features(self.positions(X), quat_from_hyperspherical(X[:, 3:]))


def features_of_poses(T: Array) -> Array:
    """Model features (n, 12) of poses (n, 4, 4): where a local adaption ended."""
    return pose_features(T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_quat())
