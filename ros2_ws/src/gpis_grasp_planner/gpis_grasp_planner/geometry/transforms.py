"""Rigid transforms as 4 x 4 matrices, and quaternions in the order x, y, z, w.

``T_a_b`` maps coordinates in frame b to coordinates in frame a: ``p_a = T_a_b @ p_b``, so that
adjacent names cancel in products: ``T_world_palm = T_world_object @ T_object_palm``.

The conversions are SciPy's (the tests hold them against it), written out: the node needs these few
alone, and importing ``scipy.spatial`` for them would cost it 35 MB.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
    """Transforms (..., 4, 4) from positions (..., 3) [m] and quaternions (..., 4), normalised."""
    quat = np.asarray(quat_xyzw, dtype=float)
    quat = quat / np.linalg.norm(quat, axis=-1, keepdims=True)
    v, w = quat[..., :3], quat[..., 3]
    R = 2.0 * (v[..., :, None] * v[..., None, :] + w[..., None, None] * cross_matrix(v))
    R[..., range(3), range(3)] += (w**2 - (v**2).sum(axis=-1))[..., None]
    return transform(R, position)


def to_position_quat_xyzw(T: ArrayLike) -> tuple[Array, Array]:
    """Positions (..., 3) and quaternions (..., 4) with w >= 0, so that q and -q agree."""
    T = np.asarray(T, dtype=float)
    R = T[..., :3, :3]
    trace = np.trace(R, axis1=-2, axis2=-1)[..., None, None]
    # Row i is 4 q_i q, and the row of the largest q_i has the most digits.
    rows = np.empty((*R.shape[:-2], 4, 4))
    rows[..., :3, :3] = R + np.swapaxes(R, -1, -2) + (1.0 - trace) * np.eye(3)
    rows[..., :3, 3] = rows[..., 3, :3] = _skew_vector(R)
    rows[..., 3, 3] = 1.0 + trace[..., 0, 0]
    best = np.argmax(np.diagonal(rows, axis1=-2, axis2=-1), axis=-1)[..., None, None]
    quat = np.take_along_axis(rows, best, axis=-2)[..., 0, :]
    quat /= np.linalg.norm(quat, axis=-1, keepdims=True)
    return T[..., :3, 3].copy(), np.where(quat[..., 3:] < 0.0, -quat, quat)


def rotation_from_rpy(rpy: ArrayLike) -> Array:
    """Rotation (3, 3) of URDF's roll, pitch, yaw [rad]: about the fixed axes x, y, z in turn."""
    R = np.eye(3)
    for axis, angle in enumerate(np.asarray(rpy, dtype=float)):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[[i, j], [i, j]] = np.cos(angle)
        turn[j, i] = np.sin(angle)
        turn[i, j] = -turn[j, i]
        R = turn @ R
    return R


def cross_matrix(v: ArrayLike) -> Array:
    """Matrices (..., 3, 3) of the cross product with vectors (..., 3): ``M @ x = v x x``."""
    v = np.asarray(v, dtype=float)
    M = np.zeros((*v.shape, 3))
    M[..., 2, 1], M[..., 0, 2], M[..., 1, 0] = v[..., 0], v[..., 1], v[..., 2]
    return M - np.swapaxes(M, -1, -2)


def rotation_about(axis: ArrayLike, angle: float) -> Array:
    """Rotation (3, 3) about a unit axis (3,) by an angle [rad], by Rodrigues' formula."""
    K = cross_matrix(np.asarray(axis, dtype=float))
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K)


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
    sine = 0.5 * np.linalg.norm(_skew_vector(R), axis=-1)
    cosine = 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0)
    return np.asarray(np.arctan2(sine, cosine))


def _skew_vector(R: Array) -> Array:
    """(..., 3): sine of the angle times twice the axis of rotations (..., 3, 3)."""
    return np.stack(
        [
            R[..., 2, 1] - R[..., 1, 2],
            R[..., 0, 2] - R[..., 2, 0],
            R[..., 1, 0] - R[..., 0, 1],
        ],
        axis=-1,
    )
