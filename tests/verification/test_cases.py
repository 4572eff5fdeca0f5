"""The cases a finalist goes through: which friction, mass and displacement, in which order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.geometry.uncertainty import SurfaceUncertainty
from gpis_grasp_planner.grasp.trials import DISPLACED
from gpis_grasp_planner.verification.cases import cad_mass, finalist_cases, spread_points
from gpis_grasp_planner.verification.result import DirectionResult, Verification
from gpis_grasp_planner.verification.settings import VerificationSettings

SETTINGS = VerificationSettings(draws=3, engine="bullet")


def test_the_first_case_is_the_strict_protocol_then_draws_then_the_corner(bar: Part) -> None:
    cases = finalist_cases(bar, Friction(0.9, 0.9), SETTINGS, seed=1)
    assert [case.displacement is None for case in cases] == [True, False, False, False, True]
    assert cases[0].settings == SETTINGS
    assert cases[-1].settings == replace(SETTINGS, friction=0.3, mass_kg=bar.mass)
    for case in cases[1:-1]:
        drawn = case.settings
        assert 0.3 < drawn.friction < 0.8
        low, high = sorted((SETTINGS.mass_kg, bar.mass))
        assert low < drawn.mass_kg < high
        assert drawn == replace(SETTINGS, friction=drawn.friction, mass_kg=drawn.mass_kg)
    assert len({case.name for case in cases}) == 5
    moved = [DISPLACED in case.name for case in cases]
    assert moved == [case.displacement is not None for case in cases]


def test_where_the_engine_is_open_the_other_one_is_asked_too(bar: Part) -> None:
    settings = replace(SETTINGS, engine="auto")
    cases = finalist_cases(bar, Friction(1, 1), settings, seed=1)
    assert len(cases) == 6
    assert cases[3].settings == SETTINGS
    assert cases[3].displacement is None
    assert {case.settings.engine for case in [*cases[:3], *cases[4:]]} == {"auto"}
    for engine in ("bullet", "mujoco", "both"):
        cases = finalist_cases(bar, Friction(1, 1), replace(SETTINGS, engine=engine), seed=1)
        assert {case.settings.engine for case in cases} == {engine}


@pytest.mark.parametrize(
    ("finger", "palm", "of_finger", "of_palm"),
    [(0.3, 0.2, 0.3, 0.2), (1.0, 0.5, 0.6, 0.5), (0.2, 0.9, 0.2, 0.6), (1.0, 1.0, 0.6, 0.6)],
)
def test_the_palm_has_its_own_friction_where_that_is_less(
    bar: Part, finger: float, palm: float, of_finger: float, of_palm: float
) -> None:
    cases = finalist_cases(bar, Friction(finger, palm), SETTINGS, seed=1)
    deciding = cases[0].settings
    for case in cases:
        share = case.settings.palm_friction_share
        decides = replace(case.settings, engine=deciding.engine) == deciding
        assert share == pytest.approx(of_palm / of_finger if decides else 1.0)
        assert (f"(palm {share * case.settings.friction:g})" in case.name) == (share != 1.0)
    assert deciding.friction == of_finger


def test_with_less_friction_than_the_settings_all_is_less(bar: Part) -> None:
    settings = replace(SETTINGS, draws=50)
    cases = finalist_cases(bar, Friction(0.2, 0.9), settings, seed=1)
    assert cases[0].settings.friction == 0.2
    assert cases[-1].settings.friction == pytest.approx(0.1)
    drawn = [case.settings.friction for case in cases[1:-1]]
    assert min(drawn) > 0.1
    assert max(drawn) < 0.8 / 3.0


def test_draws_follow_the_seed_and_have_the_stated_distribution(bar: Part, seed: int) -> None:
    settings = replace(SETTINGS, draws=1000)
    cases = finalist_cases(bar, Friction(1, 1), settings, seed)[1:-1]
    again = finalist_cases(bar, Friction(1, 1), settings, seed)[1:-1]
    other = finalist_cases(bar, Friction(1, 1), settings, seed + 1)[1:-1]
    T = np.array([case.displacement for case in cases])
    assert np.array_equal(T, [case.displacement for case in again])
    assert not np.allclose(T, [case.displacement for case in other])
    shift = T[:, :3, :3] @ bar.center_of_mass + T[:, :3, 3] - bar.center_of_mass
    turn = Rotation.from_matrix(T[:, :3, :3]).as_rotvec()
    deviation = np.array([settings.pose_noise_m] * 3 + [np.radians(settings.pose_noise_deg)] * 3)
    drawn = np.hstack([shift, turn]) / deviation
    friction = (np.array([case.settings.friction for case in cases]) - 0.3) / 0.5
    mass = np.log([case.settings.mass_kg for case in cases]) - np.log(settings.mass_kg)
    mass /= np.log(bar.mass) - np.log(settings.mass_kg)
    for normal in drawn.T:
        assert kstest(normal, "norm").statistic < 0.02  # spread evenly: below 1 / sqrt(n)
    for uniform in (friction, mass):
        assert kstest(uniform, "uniform").statistic < 0.02
    assert np.abs(np.corrcoef(np.column_stack([drawn, friction, mass]).T) - np.eye(8)).max() < 0.1


def test_displacements_have_the_covariance_of_the_pose(bar: Part, seed: int) -> None:
    settings = replace(SETTINGS, draws=1000)
    deviation = np.array([1e-3, 2e-3, 0.0, 0.01, 0.0, 0.02])
    C = np.diag(deviation**2)
    C[0, 5] = C[5, 0] = 0.5 * 1e-3 * 0.02
    cases = finalist_cases(bar, Friction(1, 1), settings, seed, C)[1:-1]
    T = np.array([case.displacement for case in cases])
    drawn = np.hstack([T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_rotvec()])
    scale = np.where(deviation > 0.0, deviation, 1.0)
    assert np.abs(np.cov((drawn / scale).T) - C / np.outer(scale, scale)).max() < 0.1
    assert np.abs(drawn.mean(axis=0) / scale).max() < 0.05


def test_any_first_points_are_spread(seed: int) -> None:
    """In every axis: the first one, friction, once fell from draw to draw by a twelfth."""
    points = spread_points(64, 8, np.random.default_rng(seed))
    assert ((points > 0.0) & (points < 1.0)).all()
    for n in (2, 4, 8, 16, 32, 64):
        for column in points[:n].T:
            assert sorted((n * column).astype(int)) == list(range(n))
    assert np.array_equal(spread_points(12, 8, np.random.default_rng(seed)), points[:12])


def test_every_single_point_is_uniform_and_its_axes_are_independent(seed: int) -> None:
    drawn = np.stack([spread_points(6, 8, np.random.default_rng([seed, k])) for k in range(2000)])
    for k in range(6):
        assert np.abs(np.corrcoef(drawn[:, k].T) - np.eye(8)).max() < 0.12
        for column in drawn[:, k].T:
            assert kstest(column, "uniform").statistic < 0.06


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
    assert finalist_cases(feather, Friction(1, 1), SETTINGS, 0)[-1].settings.mass_kg == 1e-3


def test_draws_of_a_scanned_part_go_round_its_surfaces(bar: Part) -> None:
    at, deviation = bar.mesh.vertices, np.zeros(len(bar.mesh.vertices))
    settings = replace(SETTINGS, draws=5)
    scanned = replace(bar, uncertainty=SurfaceUncertainty(at, deviation, (bar.mesh,) * 3))
    cases = finalist_cases(scanned, Friction(1, 1), settings, 0)
    plain = finalist_cases(bar, Friction(1, 1), settings, 0)
    assert [case.surface for case in plain] == [None] * len(cases)
    of_draws = [case for case in cases if case.displacement is not None]
    assert [case.surface for case in of_draws] == [0, 1, 2, 0, 1]
    assert [case.name.rpartition(", ")[2] for case in of_draws] == [
        f"surface {k}" for k in (1, 2, 3, 1, 2)
    ]
    assert cases[0].surface is None
    assert cases[-1].surface is None
    for case, same in zip(cases, plain, strict=True):
        assert case.settings == same.settings
