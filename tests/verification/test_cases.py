"""The cases a finalist goes through: which friction, mass and displacement, in which order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.geometry.transforms import rotation_angle
from gpis_grasp_planner.verification.cases import cad_mass, finalist_cases
from gpis_grasp_planner.verification.result import DirectionResult, Verification
from gpis_grasp_planner.verification.settings import VerificationSettings

SETTINGS = VerificationSettings(noise_repeats=3)


def test_the_first_case_is_the_strict_protocol_and_displaced_parts_come_last(bar: Part) -> None:
    cases = finalist_cases(bar, Friction(0.9, 0.9), SETTINGS, seed=1)
    assert [case.displacement is None for case in cases] == [True, True, False, False, False]
    assert cases[0].settings == SETTINGS
    slippery = cases[1].settings
    assert slippery == replace(SETTINGS, friction=0.3, mass_kg=bar.mass)
    assert all(case.settings == SETTINGS for case in cases[2:])
    assert len({case.name for case in cases}) == 5


def test_no_case_has_more_friction_than_was_planned_with(bar: Part) -> None:
    cases = finalist_cases(bar, Friction(0.2, 0.9), SETTINGS, seed=1)
    assert {case.settings.friction for case in cases} == {0.2}


def test_displacements_are_of_the_settings_size_and_follow_the_seed(bar: Part, seed: int) -> None:
    moves = [c.displacement for c in finalist_cases(bar, Friction(1, 1), SETTINGS, seed)[2:]]
    again = [c.displacement for c in finalist_cases(bar, Friction(1, 1), SETTINGS, seed)[2:]]
    assert np.array_equal(moves, again)
    for move in moves:
        assert move is not None
        shift = move[:3, :3] @ bar.center_of_mass + move[:3, 3] - bar.center_of_mass
        assert np.isclose(np.linalg.norm(shift), SETTINGS.noise_m)
        assert np.isclose(rotation_angle(np.eye(3), move[:3, :3]), np.radians(SETTINGS.noise_deg))


def test_displacements_have_the_covariance_of_the_pose(bar: Part, seed: int) -> None:
    n = 2000
    settings = replace(SETTINGS, noise_repeats=1000)
    deviation = np.array([1e-3, 2e-3, 0.0, 0.01, 0.0, 0.02])
    C = np.diag(deviation**2)
    C[0, 5] = C[5, 0] = 0.5 * 1e-3 * 0.02
    moves = [
        case.displacement
        for s in (seed, seed + 1)
        for case in finalist_cases(bar, Friction(1, 1), settings, s, C)[2:]
    ]
    T = np.array(moves)
    assert len(T) == n
    drawn = np.hstack([T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_rotvec()])
    scale = np.where(deviation > 0.0, deviation, 1.0)
    # entries of a sample correlation from 2000 draws have a deviation of about 0.03
    assert np.abs(np.cov((drawn / scale).T) - C / np.outer(scale, scale)).max() < 0.12
    assert np.abs(drawn.mean(axis=0) / scale).max() < 0.1


def test_a_part_beyond_the_payload_is_tried_with_the_protocols_mass(bar: Part) -> None:
    assert cad_mass(bar, SETTINGS) == bar.mass
    assert cad_mass(replace(bar, mass=7.0), SETTINGS) == SETTINGS.mass_kg


def test_an_outcome_carries_the_verdict_and_its_margins(bar: Part) -> None:
    case = finalist_cases(bar, Friction(1, 1), SETTINGS, 0)[0]
    push = DirectionResult((1.0, 0.0, 0.0), False, 0.031, 0.02, 0.5)
    verdict = Verification(False, "slipped", 0.6, 0.1, (push,), 0.0, (), 0.0, 0.0, 0.1)
    outcome = case.outcome(verdict)
    assert (outcome.name, outcome.passed, outcome.cause) == (case.name, False, "slipped")
    assert np.allclose([outcome.slip_m, outcome.rotation_rad], [0.031, 0.02])


def test_a_feather_is_tried_with_a_mass_that_the_settings_allow(bar: Part) -> None:
    feather = replace(bar, mass=2e-4)
    assert cad_mass(feather, SETTINGS) == 1e-3
    assert finalist_cases(feather, Friction(1, 1), SETTINGS, 0)[1].settings.mass_kg == 1e-3
