import numpy as np
import pytest
from scipy.optimize import approx_fprime
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.transforms import rotation_angle
from gpis_grasp_planner.optimise.distances import (
    EuclideanDistance,
    GeodesicSumDistance,
    PoseDistance,
    pose_features,
)
from gpis_grasp_planner.optimise.kernel import correlation

ALL = [EuclideanDistance([0] * 3 + [1] * 9), PoseDistance(), GeodesicSumDistance()]


def smallest_eigenvalue(distance, features, scales):
    return np.linalg.eigvalsh(correlation(distance, features, features, np.asarray(scales)))[0]


def test_euclidean_distance_is_the_scaled_norm():
    rng = np.random.default_rng(1)
    A, B = rng.normal(size=(7, 3)), rng.normal(size=(5, 3))
    scales = np.array([0.5, 2.0])
    weights = 1 / np.array([0.5, 2.0, 2.0])
    got = EuclideanDistance([0, 1, 1]).matrix(A, B, scales)
    np.testing.assert_allclose(got, cdist(A * weights, B * weights), atol=1e-14)


@pytest.mark.parametrize("distance", ALL, ids=lambda d: type(d).__name__)
def test_distances_are_symmetric_and_zero_only_at_home(distance, random_poses):
    F = pose_features(*random_poses(40, 2))
    D = distance.matrix(F, F, np.array([0.1, 0.7]))
    np.testing.assert_allclose(D, D.T, atol=1e-7)
    np.testing.assert_allclose(np.diag(D), 0.0, atol=3e-7)
    assert D[~np.eye(40, dtype=bool)].min() > 1e-2


def test_the_sign_of_a_quaternion_does_not_matter(random_poses):
    t, q = random_poses(50, 3)
    np.testing.assert_array_equal(pose_features(t, q), pose_features(t, -q))
    np.testing.assert_allclose(pose_features(t, q), pose_features(t, 3.0 * q), atol=1e-15)


def test_pose_distance_is_chordal_and_agrees_with_the_angle_when_small(random_poses):
    t, q = random_poses(60, 4)
    R = Rotation.from_quat(q).as_matrix()
    angle = rotation_angle(R[:, None], R[None])
    F = pose_features(t, q)
    F[:, :3] = 0.0
    chord = PoseDistance().matrix(F, F, np.ones(2))
    np.testing.assert_allclose(chord, 2 * np.abs(np.sin(angle / 2)), atol=1e-7)
    frobenius = np.linalg.norm(R[:, None] - R[None], axis=(2, 3))
    np.testing.assert_allclose(chord, frobenius / np.sqrt(2), atol=1e-7)
    assert np.all(angle - chord <= angle**3 / 24 + 1e-7)


def test_the_sum_is_the_distance_printed_in_the_paper(random_poses):
    t, q = random_poses(60, 5)
    R = Rotation.from_quat(q)
    expected = cdist(t, t)
    for i in range(60):
        # |log(R1^T R2)|_F / sqrt(2) is the length of the rotation vector.
        expected[i] += np.linalg.norm((R[i].inv() * R).as_rotvec(), axis=1)
    F = pose_features(t, q)
    got = GeodesicSumDistance().matrix(F, F, np.ones(2))
    np.testing.assert_allclose(got, expected, atol=1e-7)


@pytest.mark.parametrize("distance", ALL, ids=lambda d: type(d).__name__)
def test_slopes_are_the_derivatives_by_the_log_scales(distance, random_poses):
    F = pose_features(*random_poses(2, 6))
    log_scales = np.log([0.13, 0.8])
    d, slopes = distance.slopes(distance.parts(F), np.exp(log_scales))
    expected = approx_fprime(
        log_scales, lambda p: distance.matrix(F, F, np.exp(p))[0, 1], np.sqrt(1e-15)
    )
    np.testing.assert_allclose(-slopes[:, 0, 1] / d[0, 1], expected, rtol=1e-5)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("rotation_scale", [0.3, 0.6, 1.0, 2.5, 5.0, 20.0])
@pytest.mark.parametrize("translation_scale", [0.02, 0.2, 2.0])
def test_ours_is_definite_at_every_length_scale(
    translation_scale, rotation_scale, seed, random_poses
):
    F = pose_features(*random_poses(300, seed))
    # Rounding alone may reach n eps times the largest eigenvalue (at most n).
    limit = -300 * 300 * np.finfo(float).eps
    assert smallest_eigenvalue(PoseDistance(), F, [translation_scale, rotation_scale]) > limit


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("rotation_scale", "at_most"), [(1.0, -1e-3), (2.5, -1.0), (5.0, -1.0)])
def test_the_papers_is_not_definite_on_rotations(rotation_scale, at_most, seed, random_poses):
    t, q = random_poses(300, seed)
    F = pose_features(np.zeros_like(t), q)
    found = smallest_eigenvalue(GeodesicSumDistance(), F, [1.0, rotation_scale])
    print(f"seed {seed}, length scale {rotation_scale} rad: smallest eigenvalue {found:.4f}")
    assert found < at_most
    assert not GeodesicSumDistance.definite
    assert smallest_eigenvalue(PoseDistance(), F, [1.0, rotation_scale]) > -1e-10


def test_the_paper_s_is_not_definite_on_whole_poses(random_poses):
    F = pose_features(*random_poses(300, 1))
    assert smallest_eigenvalue(GeodesicSumDistance(), F, [2.5, 2.5]) < -0.5


@pytest.mark.parametrize("groups", [[], [1, 1], [0, 2], [-1, 0]])
def test_groups_with_gaps_are_refused(groups):
    with pytest.raises(RequestError, match="group index") as caught:
        EuclideanDistance(groups)
    assert caught.value.code is ErrorCode.INVALID_SETTING


@pytest.mark.parametrize("bounds", [(0.0, 1.0), (2.0, 1.0), (0.1, np.inf), (np.nan, 1.0)])
def test_bad_length_scale_bounds_are_refused(bounds):
    with pytest.raises(RequestError, match="0 < low <= high"):
        PoseDistance(translation_bounds=bounds)
