import numpy as np
import pytest

from gpis_grasp_planner.optimise.candidate_posterior import CandidatePosterior
from gpis_grasp_planner.optimise.distances import PoseDistance, pose_features
from gpis_grasp_planner.optimise.gaussian_process import GaussianProcess


@pytest.fixture
def process(random_poses):
    t, q = random_poses(40, 1)
    process = GaussianProcess(PoseDistance())
    process.fit(pose_features(t, q), np.sin(10 * t[:, 0]) + q[:, 3] ** 2)
    return process


def test_beliefs_equal_appending_the_mean_to_a_copy(process, random_poses):
    F = pose_features(*random_poses(60, 2))
    posterior = CandidatePosterior(process, F, 5)
    mean, std = process.predict(F)
    np.testing.assert_allclose(posterior.mean, mean, atol=1e-10)
    np.testing.assert_allclose(posterior.std, std, atol=1e-8)
    unit = process.target_std
    other = process.copy()
    for index in [3, 17, 3, 40, 59]:
        posterior.believe(index)
        other.append(F[index : index + 1], other.predict_mean(F[index : index + 1]))
        # Appending changes the unit of standardisation; the believer keeps it.
        np.testing.assert_allclose(
            posterior.std / unit, other.predict(F)[1] / other.target_std, atol=1e-6
        )
    np.testing.assert_allclose(posterior.mean, mean, atol=1e-10)
    assert np.all(posterior.std <= std + 1e-12)
