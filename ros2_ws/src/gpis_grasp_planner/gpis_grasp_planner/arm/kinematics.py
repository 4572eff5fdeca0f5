"""Forward kinematics, Jacobian and manipulability of an arm, for many joint vectors at once."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.arm.urdf import ArmChain
from gpis_grasp_planner.hand.kinematics import rotation_about

Array = NDArray[np.float64]

_SAMPLES = 2000


def link_poses(chain: ArmChain, joints: Array) -> Array:
    """Poses (B, n + 2, 4, 4) in the base: the base itself, the n links, the flange.

    Parameters
    ----------
    chain : ArmChain
    joints : (B, n) array [rad]
    """
    joints = np.atleast_2d(joints)
    n = len(chain.joint_names)
    T = np.empty((len(joints), n + 2, 4, 4))
    T[:, 0] = np.eye(4)
    for i in range(n):
        turn = rotation_about(chain.joint_axis[i], joints[:, i])
        T[:, i + 1] = T[:, i] @ chain.T_parent_joint[i] @ turn
    T[:, n + 1] = T[:, n] @ chain.T_last_flange
    return T


def flange_poses(chain: ArmChain, joints: Array) -> Array:
    """Poses (B, 4, 4) of the flange in the base, at joints (B, n) [rad]."""
    return np.asarray(link_poses(chain, joints)[:, -1])


def jacobians(chain: ArmChain, joints: Array) -> Array:
    """Geometric Jacobians (B, 6, n) of the flange in the base's frame: [velocity; turning]."""
    T = link_poses(chain, joints)
    axis = np.einsum("bnij,nj->bni", T[:, 1:-1, :3, :3], chain.joint_axis)
    lever = T[:, -1:, :3, 3] - T[:, 1:-1, :3, 3]
    return np.concatenate([np.cross(axis, lever), axis], axis=-1).swapaxes(1, 2)


def manipulability(chain: ArmChain, joints: Array) -> Array:
    """Yoshikawa's measure (B,) ``sqrt(det(J J^T))`` (1985, eq. 9), lengths in metres.

    For six joints that is ``|det(J)|``; it is 0 where the flange cannot move in some direction.
    """
    singular = np.linalg.svd(jacobians(chain, joints), compute_uv=False)
    return np.asarray(singular.prod(axis=-1))


@lru_cache(maxsize=8)
def largest_manipulability(chain: ArmChain) -> float:
    """The largest of 2000 random postures within the limits (seeded): what counts as 1.

    50 ms, once for a chain that was loaded.
    """
    rng = np.random.default_rng(0)
    joints = rng.uniform(chain.joint_lower, chain.joint_upper, (_SAMPLES, len(chain.joint_names)))
    return float(manipulability(chain, joints).max())
