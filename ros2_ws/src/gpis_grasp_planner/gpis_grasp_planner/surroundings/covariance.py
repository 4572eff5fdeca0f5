"""The covariance of a part's pose: what it may be, and whose axes it is in.

(6, 6) in the order x, y, z, rotation about x, y, z [m, rad], as in ROS: the rotations are about the
fixed axes of the frame in which the pose is given, through the object's origin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.errors import ErrorCode, PoseError

Array = NDArray[np.float64]

_SYMMETRY = 1e-6
_NEGATIVE = 1e-6
_LARGEST = 1e6
_NEARLY = 0.1


def covariance_in_object(covariance: ArrayLike, R_world_object: ArrayLike) -> Array:
    """A pose's covariance (6, 6) with the object's axes instead of the world's."""
    turn = np.kron(np.eye(2), np.asarray(R_world_object, dtype=float).T)
    return np.asarray(turn @ np.asarray(covariance, dtype=float) @ turn.T)


def covariance_moved(covariance: ArrayLike, offset: ArrayLike) -> Array:
    """A pose's covariance (6, 6) for another point of the same body, `offset` (3,) [m] away.

    The offset is in the axes of the covariance. A turn dr of the body moves the point by
    ``dr x offset``.
    """
    x, y, z = np.asarray(offset, dtype=float)
    J = np.eye(6)
    J[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return np.asarray(J @ np.asarray(covariance, dtype=float) @ J.T)


def nearly_equal(first: Array, second: Array) -> bool:
    """Whether two covariances (6, 6) say the same for what is estimated from some samples.

    No entry differs by more than a tenth of the variances it belongs to, so that no deviation
    does by more than some 5 %. The direction of a difference does not matter.
    """
    variances = np.minimum(np.diag(first), np.diag(second))
    scale = np.sqrt(np.outer(variances, variances))
    return bool((np.abs(first - second) <= _NEARLY * scale).all())


def check_covariance(covariance: ArrayLike, of: str = "the pose") -> Array:
    """Return a covariance (6, 6), exactly symmetric, or raise PoseError saying what is wrong.

    It must be finite, at most 1e6, symmetric and without a negative variance in any direction,
    all but for 1e-6 of its largest entry. Zeros are allowed: what is known exactly.

    Parameters
    ----------
    covariance : (6, 6) array
    of : str
        Whose covariance it is, for the message.

    Raises
    ------
    PoseError
        INVALID_COVARIANCE.
    """
    C = np.asarray(covariance, dtype=float)
    if C.shape != (6, 6):
        raise _invalid(of, f"has the shape {C.shape}; it must be (6, 6), 36 numbers")
    if not np.isfinite(C).all():
        raise _invalid(of, "has entries that are not finite")
    scale = max(float(np.abs(C).max()), 1e-300)
    if scale > _LARGEST:
        raise _invalid(of, f"has the entry {scale:.3g}; the limit is {_LARGEST:g} (m^2, rad^2)")
    if np.abs(C - C.T).max() > _SYMMETRY * scale:
        off = np.abs(C - C.T).max()
        raise _invalid(of, f"is not symmetric: it differs from its transpose by {off:.3g}")
    least = float(np.linalg.eigvalsh(0.5 * (C + C.T))[0])
    if least < -_NEGATIVE * scale:
        raise _invalid(of, f"has the negative eigenvalue {least:.3g}; the limit is 0")
    return np.asarray(0.5 * (C + C.T))


def _invalid(of: str, what: str) -> PoseError:
    return PoseError(
        f"The covariance of {of} {what}. Send a valid one (x, y, z, rotation about x, y, z), or "
        "all zeros if it is not known.",
        ErrorCode.INVALID_COVARIANCE,
    )
