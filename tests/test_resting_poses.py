"""Resting poses of solids whose probabilities are known."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from resting_poses import resting_poses

CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


def test_a_cube_rests_on_each_face_alike():
    poses = resting_poses(0.02 * CORNERS, np.zeros(3))
    assert len(poses) == 6
    assert [p.probability for p in poses] == pytest.approx([1 / 6] * 6, abs=0.003)
    assert {tuple(np.round(p.up)) for p in poses} == {
        tuple(r) for s in (1, -1) for r in s * np.eye(3)
    }


def test_a_boxs_shares_are_the_solid_angles_of_its_faces():
    half = np.array([0.01, 0.02, 0.03])
    poses = resting_poses(half * CORNERS, np.zeros(3))
    a, b, c = half
    angle = 4.0 * np.arctan(b * c / (a * np.sqrt(a**2 + b**2 + c**2)))
    assert abs(poses[0].up[0]) == pytest.approx(1.0)
    assert poses[0].probability == pytest.approx(angle / (4.0 * np.pi), abs=0.003)
    assert sum(p.probability for p in poses) == pytest.approx(1.0)


def test_a_face_that_the_centre_does_not_stand_over_is_left():
    # a slanted prism: its small end faces lean over, so it falls on a long side
    slant = 0.02 * CORNERS * [1.0, 1.0, 2.0]
    slant[:, 0] += 1.5 * slant[:, 2]
    poses = resting_poses(slant, np.zeros(3))
    assert all(abs(p.up[2]) < 0.99 for p in poses)
