"""Displacements are as large as said, and repeat with their seed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.transforms import apply, rotation_angle
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.verification.pose_noise import random_displacement, verify_under_noise
from gpis_grasp_planner.verification.settings import VerificationSettings


def test_a_displacement_is_as_large_as_said(rng: np.random.Generator) -> None:
    center = np.array([0.1, -0.2, 0.3])
    moves = [random_displacement(rng, 0.005, np.radians(5.0), center) for _ in range(400)]
    for T in moves:
        assert np.linalg.norm(apply(T, center[None])[0] - center) == pytest.approx(0.005)
        assert rotation_angle(np.eye(3), T[:3, :3]) == pytest.approx(np.radians(5.0))
    shifts = np.array([apply(T, center[None])[0] - center for T in moves]) / 0.005
    assert np.abs(shifts.mean(axis=0)).max() < 0.15
    assert (shifts**2).mean(axis=0) == pytest.approx(np.full(3, 1 / 3), abs=0.08)


def test_a_firm_grasp_bears_a_displaced_part(bar: Part, hand: HandDescription, firm: Grasp) -> None:
    settings = VerificationSettings(noise_repeats=3)
    [found] = verify_under_noise(bar, hand, [firm], settings, seed=1)
    [again] = verify_under_noise(bar, hand, [firm], settings, seed=1)
    assert found.share_held == 1.0
    assert [r.directions for r in again.repeats] == [r.directions for r in found.repeats]
    assert found.as_dict()["seed"] == 1


def test_a_hand_that_cannot_come_near_fails(bar: Part, hand: HandDescription, firm: Grasp) -> None:
    T = firm.T_object_palm.copy()
    T[:3, 3] += 0.05 * T[:3, 2]
    settings = VerificationSettings(noise_repeats=1)
    [found] = verify_under_noise(bar, hand, [replace(firm, T_object_palm=T)], settings)
    assert [repeat.cause for repeat in found.repeats] == ["collision"]
