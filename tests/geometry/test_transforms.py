"""Transforms: group laws, the paper's rotation angle, quaternions in the order x, y, z, w."""

import numpy as np
import pytest
from scipy.linalg import logm
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.transforms import (
    apply,
    from_position_quat_xyzw,
    inverse,
    rotation_angle,
    rotation_from_rpy,
    to_position_quat_xyzw,
    transform,
)


def random_transforms(rng, n):
    return transform(Rotation.random(n, rng=rng).as_matrix(), rng.normal(size=(n, 3)))


def test_quarter_turn_about_z_has_the_known_quaternion_and_effect():
    half = np.sqrt(0.5)
    T = from_position_quat_xyzw([1.0, 2.0, 3.0], [0.0, 0.0, half, half])
    np.testing.assert_allclose(apply(T, [[1.0, 0.0, 0.0]]), [[1.0, 3.0, 3.0]], atol=1e-15)
    position, quat = to_position_quat_xyzw(T)
    np.testing.assert_array_equal(position, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(quat, [0.0, 0.0, half, half], atol=1e-15)


def test_quaternion_round_trip_and_sign(rng):
    quat = Rotation.random(200, rng=rng).as_quat()
    position = rng.normal(size=(200, 3))
    T = from_position_quat_xyzw(position, quat)
    back_position, back = to_position_quat_xyzw(T)
    np.testing.assert_array_equal(back_position, position)
    assert (back[:, 3] >= 0.0).all()
    np.testing.assert_allclose(back, quat * np.sign(quat[:, 3:]), atol=1e-12)
    _, of_negated = to_position_quat_xyzw(from_position_quat_xyzw(position, -quat))
    np.testing.assert_allclose(of_negated, back, atol=1e-12)


HALF_TURNS = np.vstack([np.eye(4), [[1, 1, 0, 0], [1, -1, 0, 0], [0, -1, 1, 0], [1, 1, 1, 0]]])


def test_quaternions_and_rotations_are_scipys(rng):
    near = HALF_TURNS + rng.normal(scale=1e-9, size=(50, *HALF_TURNS.shape))
    for quats in (rng.normal(size=(2000, 4)), HALF_TURNS, -HALF_TURNS, near.reshape(-1, 4)):
        expected = Rotation.from_quat(quats)
        T = from_position_quat_xyzw(np.zeros(3), quats)
        np.testing.assert_allclose(T[..., :3, :3], expected.as_matrix(), atol=2e-15)
        _, back = to_position_quat_xyzw(T)
        agreement = np.abs(np.sum(back * expected.as_quat(), axis=-1))
        np.testing.assert_allclose(agreement, 1.0, atol=1e-15)
        np.testing.assert_allclose(np.linalg.norm(back, axis=-1), 1.0, atol=1e-15)
        assert (back[:, 3] >= 0.0).all()


def test_roll_pitch_yaw_is_scipys_about_fixed_axes(rng):
    for rpy in rng.uniform(-4.0, 4.0, size=(100, 3)):
        expected = Rotation.from_euler("xyz", rpy).as_matrix()
        np.testing.assert_allclose(rotation_from_rpy(rpy), expected, atol=2e-15)


def test_inverse_undoes_and_reverses_products(rng):
    A, B = random_transforms(rng, 50), random_transforms(rng, 50)
    np.testing.assert_allclose(A @ inverse(A), np.tile(np.eye(4), (50, 1, 1)), atol=1e-14)
    np.testing.assert_allclose(inverse(A @ B), inverse(B) @ inverse(A), atol=1e-13)
    np.testing.assert_allclose(inverse(A), np.linalg.inv(A), atol=1e-13)


def test_apply_is_the_homogeneous_product(rng):
    T = random_transforms(rng, 1)[0]
    points = rng.normal(size=(20, 3))
    expected = (T @ np.column_stack([points, np.ones(20)]).T).T[:, :3]
    np.testing.assert_allclose(apply(T, points), expected, atol=1e-14)


def test_transform_broadcasts_one_rotation_over_many_positions(rng):
    T = transform(np.eye(3), rng.normal(size=(4, 5, 3)))
    assert T.shape == (4, 5, 4, 4)
    np.testing.assert_array_equal(T[..., 3, :], np.broadcast_to([0, 0, 0, 1], (4, 5, 4)))


def test_to_position_does_not_share_memory():
    T = np.eye(4)
    position, _ = to_position_quat_xyzw(T)
    position[:] = 7.0
    np.testing.assert_array_equal(T, np.eye(4))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.5, 3.0, np.pi - 1e-7, np.pi])
def test_rotation_angle_is_precise_at_both_ends(angle, rng):
    axis = rng.normal(size=3)
    R_1 = Rotation.random(rng=rng)
    R_2 = R_1 * Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
    np.testing.assert_allclose(
        rotation_angle(R_1.as_matrix(), R_2.as_matrix()), angle, rtol=1e-6, atol=1e-14
    )


def test_rotation_angle_is_the_papers_norm_of_the_logarithm_and_a_metric(rng):
    R = Rotation.random(30, rng=rng).as_matrix()
    for a, b, c in zip(R[:10], R[10:20], R[20:], strict=True):
        papers = np.linalg.norm(logm(a.T @ b).real, "fro") / np.sqrt(2.0)
        assert rotation_angle(a, b) == pytest.approx(papers, abs=1e-7)
        assert rotation_angle(a, b) == pytest.approx(rotation_angle(b, a), abs=1e-14)
        assert rotation_angle(a, c) <= rotation_angle(a, b) + rotation_angle(b, c) + 1e-12
