from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from gpis_grasp_benchmark.ranking_runs import noise_covariance
from gpis_grasp_planner.plan.warm_up import box_part
from gpis_grasp_planner.verification.pose_noise import displacements
from gpis_grasp_planner.verification.settings import VerificationSettings


def test_the_covariance_is_that_of_the_trials_displacements() -> None:
    """Of (shift, turn) in the order and sense of `perturbed_palms`, also off the origin."""
    part = replace(box_part(), center_of_mass=np.array([0.03, -0.02, 0.05]))
    settings = VerificationSettings(noise_repeats=1000)
    moves = np.concatenate([displacements(part, settings, seed) for seed in range(20)])
    turns = Rotation.from_matrix(moves[:, :3, :3]).as_rotvec()
    sample = np.cov(np.concatenate([moves[:, :3, 3], turns], axis=1).T)
    C = noise_covariance(part, settings)
    unit = np.sqrt(np.diag(C))
    np.testing.assert_allclose(sample / np.outer(unit, unit), C / np.outer(unit, unit), atol=0.03)
