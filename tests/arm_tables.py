"""Published Denavit-Hartenberg tables of the two arms, and forward kinematics by them alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.arm.description import load_arm

PI = np.pi
# d, a, alpha as the makers publish them.
DH = {
    "six_axis": [
        (0.1625, 0.0, PI / 2), (0.0, -0.425, 0.0), (0.0, -0.3922, 0.0),
        (0.1333, 0.0, PI / 2), (0.0997, 0.0, -PI / 2), (0.0996, 0.0, 0.0),
    ],
    "seven_axis": [
        (0.34, 0.0, -PI / 2), (0.0, 0.0, PI / 2), (0.4, 0.0, PI / 2), (0.0, 0.0, -PI / 2),
        (0.4, 0.0, -PI / 2), (0.0, 0.0, PI / 2), (0.126, 0.0, 0.0),
    ],
}  # fmt: skip


def dh_flange(name: str, joints: NDArray[np.float64]) -> NDArray[np.float64]:
    """Flange pose by the table: Rot_z(q) Trans(a, 0, d) Rot_x(alpha), row after row."""
    T = np.eye(4)
    for q, (d, a, alpha) in zip(joints, DH[name], strict=True):
        c, s, ca, sa = np.cos(q), np.sin(q), np.cos(alpha), np.sin(alpha)
        T = T @ np.array(
            [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        )
    return T


def random_joints(name: str, n: int, seed: int) -> NDArray[np.float64]:
    chain = load_arm(name).chain
    print("seed", seed)
    rng = np.random.default_rng(seed)
    return rng.uniform(chain.joint_lower, chain.joint_upper, (n, len(chain.joint_names)))
