"""Forward kinematics against the Denavit-Hartenberg tables, multiplied out without the URDF."""

from __future__ import annotations

import numpy as np
import pytest
from arm_tables import DH, dh_flange, random_joints

from gpis_grasp_planner.arm.description import available_arms, load_arm
from gpis_grasp_planner.arm.kinematics import (
    flange_poses,
    jacobians,
    largest_manipulability,
    manipulability,
)
from gpis_grasp_planner.geometry.transforms import rotation_angle


@pytest.mark.parametrize("name", DH)
def test_the_urdf_is_the_table(name: str) -> None:
    joints = random_joints(name, 50, 1)
    expected = np.array([dh_flange(name, q) for q in joints])
    np.testing.assert_allclose(flange_poses(load_arm(name).chain, joints), expected, atol=1e-10)


def test_known_postures() -> None:
    # stretched along -x, and the seven-axis arm straight up: by adding lengths
    six = flange_poses(load_arm("six_axis").chain, np.zeros((1, 6)))[0]
    np.testing.assert_allclose(
        six[:3, 3], [-0.425 - 0.3922, -0.1333 - 0.0996, 0.1625 - 0.0997], atol=1e-12
    )
    seven = flange_poses(load_arm("seven_axis").chain, np.zeros((1, 7)))[0]
    np.testing.assert_allclose(seven[:3, 3], [0.0, 0.0, 0.34 + 0.4 + 0.4 + 0.126], atol=1e-12)
    np.testing.assert_allclose(seven[:3, :3], np.eye(3), atol=1e-12)


@pytest.mark.parametrize("name", DH)
def test_jacobian_by_differences(name: str) -> None:
    chain, step = load_arm(name).chain, 1e-6
    for q in random_joints(name, 5, 2):
        J = jacobians(chain, q[None])[0]
        for k in range(len(q)):
            ends = q + np.outer([-step, step], np.eye(len(q))[k])
            a, b = flange_poses(chain, ends)
            np.testing.assert_allclose((b - a)[:3, 3] / (2 * step), J[:3, k], atol=1e-8)
            turn = (b - a)[:3, :3] / (2 * step) @ flange_poses(chain, q[None])[0, :3, :3].T
            found = [turn[2, 1], turn[0, 2], turn[1, 0]]
            np.testing.assert_allclose(found, J[3:, k], atol=1e-8)
            assert rotation_angle(a[:3, :3], b[:3, :3]) == pytest.approx(2 * step, rel=1e-6)


def test_manipulability_is_the_determinant_and_vanishes_when_stretched() -> None:
    chain = load_arm("six_axis").chain
    joints = random_joints("six_axis", 20, 3)
    expected = np.abs(np.linalg.det(jacobians(chain, joints)))
    np.testing.assert_allclose(manipulability(chain, joints), expected, atol=1e-12)
    stretched = np.array([[0.3, -1.0, 0.0, 0.4, 0.9, 0.0]])
    assert manipulability(chain, stretched)[0] < 1e-12
    assert (manipulability(chain, joints) <= 1.2 * largest_manipulability(chain)).all()


def test_both_arms_are_there() -> None:
    assert set(available_arms()) == set(DH)
