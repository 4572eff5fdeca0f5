"""Rigid transforms as 4 x 4 matrices, and quaternions in the order x, y, z, w.

``T_a_b`` maps coordinates in frame b to coordinates in frame a: ``p_a = T_a_b @ p_b``, so that
adjacent names cancel in products: ``T_world_palm = T_world_object @ T_object_palm``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def transform(rotation: ArrayLike, translation: ArrayLike) -> Array:
    """Stack rotations (..., 3, 3) and translations (..., 3) [m] into transforms (..., 4, 4)."""
    rotation = np.asarray(rotation, dtype=float)
    translation = np.asarray(translation, dtype=float)
    shape = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    T = np.zeros((*shape, 4, 4))
    T[..., :3, :3] = rotation
    T[..., :3, 3] = translation
    T[..., 3, 3] = 1.0
    return T


def from_position_quat_xyzw(position: ArrayLike, quat_xyzw: ArrayLike) -> Array:
    """Transforms (..., 4, 4) from positions (..., 3) [m] and unit quaternions (..., 4)."""
    return transform(Rotation.from_quat(np.asarray(quat_xyzw)).as_matrix(), position)


def to_position_quat_xyzw(T: ArrayLike) -> tuple[Array, Array]:
    """Positions (..., 3) and quaternions (..., 4) with w >= 0, so that q and -q agree."""
    T = np.asarray(T, dtype=float)
    quat = Rotation.from_matrix(T[..., :3, :3]).as_quat(canonical=True)
    return T[..., :3, 3].copy(), quat


def inverse(T: ArrayLike) -> Array:
    """Inverse of rigid transforms (..., 4, 4)."""
    T = np.asarray(T, dtype=float)
    R_t = np.swapaxes(T[..., :3, :3], -1, -2)
    return transform(R_t, -(R_t @ T[..., :3, 3, None])[..., 0])


def apply(T: ArrayLike, points: ArrayLike) -> Array:
    """Map points (n, 3) by one transform (4, 4)."""
    T = np.asarray(T, dtype=float)
    return np.asarray(points, dtype=float) @ T[:3, :3].T + T[:3, 3]


def rotation_angle(R_1: ArrayLike, R_2: ArrayLike) -> Array:
    """Geodesic angle [rad] in [0, pi] between rotations (..., 3, 3).

    Equal to the paper's ``||log(R_1^T R_2)||_F / sqrt(2)`` (section III, below the kernel).
    The arc tangent keeps full precision near 0 and pi, where the arc cosine of the trace has none.
    """
    R = np.swapaxes(np.asarray(R_1, dtype=float), -1, -2) @ np.asarray(R_2, dtype=float)
    skew = np.stack(
        [
            R[..., 2, 1] - R[..., 1, 2],
            R[..., 0, 2] - R[..., 2, 0],
            R[..., 1, 0] - R[..., 0, 1],
        ],
        axis=-1,
    )
    sine = 0.5 * np.linalg.norm(skew, axis=-1)
    cosine = 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0)
    return np.asarray(np.arctan2(sine, cosine))
