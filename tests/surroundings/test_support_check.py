"""A part on, in and over its support."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.surroundings.clearance_settings import ClearanceSettings
from gpis_grasp_planner.surroundings.obstacles import SupportPlane, Surroundings
from gpis_grasp_planner.surroundings.place import Place
from gpis_grasp_planner.surroundings.support_check import check_support

SETTINGS = ClearanceSettings()
TILTED = np.array([0.6, 0.0, 0.8])


@pytest.fixture(scope="module")
def cube(oracle):
    """60 mm wide: its faces are 30 mm from its origin."""
    return oracle.make_part("cube", trimesh.creation.box([0.06, 0.06, 0.06]))


def place_at(height, covariance=None):
    """The cube's lowest face `height` over a tilted plane, parallel to it."""
    R = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])  # z along the normal
    point = np.array([0.4, -0.1, 0.9])
    T = transform(R, point + (0.03 + height) * TILTED)
    return Place(T, Surroundings(SupportPlane(point, TILTED)), covariance)


@pytest.mark.parametrize("height", [0.0, 1e-4, -5e-4, 0.004])
def test_what_lies_on_its_support_is_not_spoken_of(height, cube):
    assert check_support(cube, place_at(height), SETTINGS) == ()


def test_no_support_no_word(cube):
    assert check_support(cube, Place(), SETTINGS) == ()


@pytest.mark.parametrize(
    ("height", "word"), [(-0.003, "reaches 3.0 mm below"), (0.02, "hovers 20.0 mm above")]
)
def test_a_little_off_is_a_note_with_the_height(height, word, cube):
    [note] = check_support(cube, place_at(height), SETTINGS)
    assert word in note


@pytest.mark.parametrize(
    ("height", "word"), [(-0.0105, "reaches into"), (-0.059, "reaches into"), (-0.1, "wholly")]
)
def test_a_support_that_cuts_the_part_is_refused_with_the_depth(height, word, cube):
    with pytest.raises(RequestError) as caught:
        check_support(cube, place_at(height), SETTINGS)
    assert caught.value.code is ErrorCode.INVALID_SCENE
    assert word in caught.value.message
    assert f"{-1e3 * height:.1f} mm below the plane; 5.0 mm are allowed" in caught.value.message


def test_an_uncertain_pose_may_be_wrong_by_three_sigma_along_the_normal(cube):
    along = np.diag([1e-12, 1e-12, 0.002**2, 1e-12, 1e-12, 1e-12])  # the cube's z is the normal
    across = np.diag([0.002**2, 0.002**2, 1e-12, 1e-12, 1e-12, 1e-12])
    assert len(check_support(cube, place_at(-0.0105, along), SETTINGS)) == 1
    with pytest.raises(RequestError):
        check_support(cube, place_at(-0.0105, across), SETTINGS)
    with pytest.raises(RequestError):
        check_support(cube, place_at(-0.0115, along), SETTINGS)
