"""Two-sided exports and walls inside bodies: what encloses a solid is found under them."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_dialects import box, stl_corners

from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.geometry.defects import Judged, judge

L_VOLUME = 3 * 0.02**3


def _soup(*triangles) -> Judged:
    corners = np.concatenate(triangles).reshape(-1, 3).round(9)
    return judge(
        corners,
        np.arange(len(corners)).reshape(-1, 3),
        name="part",
        unit="m",
        settings=CatalogueSettings(),
    )


def _cube(at=(0.0, 0.0, 0.0)) -> np.ndarray:
    """A cube of 20 mm about a point."""
    return 1e-3 * stl_corners(box((20, 20, 20)).moved((-10, -10, -10))) + np.asarray(at)


def _shared(cube, x):
    return (np.abs(cube[:, :, 0] - x) < 1e-9).all(axis=1)


def _l_shape() -> np.ndarray:
    """Three cubes in an L, without the walls between them."""
    middle, right, up = _cube(), _cube((0.02, 0, 0)), _cube((0, 0.02, 0))
    top = (np.abs(middle[:, :, 1] - 0.01) < 1e-9).all(axis=1)
    bottom = (np.abs(up[:, :, 1] - 0.01) < 1e-9).all(axis=1)
    return np.concatenate(
        [middle[~_shared(middle, 0.01) & ~top], right[~_shared(right, 0.01)], up[~bottom]]
    )


@pytest.fixture
def wall() -> np.ndarray:
    """The two triangles between the first two cubes."""
    cube = _cube()
    return cube[_shared(cube, 0.01)]


def _is_the_l_shape(judged: Judged, note: str) -> None:
    assert judged.watertight
    assert judged.volume == pytest.approx(L_VOLUME, rel=1e-9)
    assert len(judged.mesh.faces) == len(_l_shape())
    assert [n for n in judged.notes if note in n]
    assert not any("overlap" in n or "hull" in n or "nothing tells" in n for n in judged.notes)


@pytest.mark.parametrize("mixed", [False, True])
def test_faces_from_both_sides_are_one_surface(mixed, rng):
    shape = _l_shape()
    both = np.concatenate([shape, shape[:, ::-1]])
    if mixed:
        both = both[rng.permutation(len(both))]
    _is_the_l_shape(_soup(both), f"{len(shape)} faces that repeat others from behind")


def test_a_few_faces_from_behind():
    shape = _l_shape()
    _is_the_l_shape(_soup(shape, shape[3:7, ::-1]), "4 faces that repeat others from behind")


def test_a_wall_in_a_body_is_left_out(wall):
    _is_the_l_shape(_soup(_l_shape(), wall), "2 faces inside the body")
    _is_the_l_shape(_soup(_l_shape(), wall, wall[:, ::-1]), "4 faces inside the body")


def test_a_sheet_that_hangs_in_a_body_is_left_out(wall):
    _is_the_l_shape(_soup(_l_shape(), 0.5 * wall), "2 faces inside the body")


def test_bodies_that_touch_are_one():
    judged = _soup(_cube(), _cube((0.02, 0, 0)), _cube((0, 0.02, 0)))
    _is_the_l_shape(judged, "8 faces inside the body")


def test_a_fin_outside_of_a_body_stays(wall):
    judged = _soup(_l_shape(), wall + np.array([0.03, 0.0, 0.0]))
    assert len(judged.mesh.faces) == len(_l_shape()) + 2


def test_a_sheet_in_a_cavity_stays(wall):
    cavity = 2.0 * _cube()
    judged = _soup(3.0 * _cube(), cavity[:, ::-1], wall)
    assert len(judged.mesh.faces) == 12 + 12 + 2


def test_an_overlap_at_the_corners_of_large_faces_is_noted():
    judged = _soup(_cube(), _cube((0.01, 0.01, 0.01)))
    assert any("overlap" in n for n in judged.notes)


def test_a_thin_plate_does_not_intersect_itself():
    judged = _soup(1e-3 * stl_corners(box((80, 60, 0.01))))
    assert judged.watertight
    assert judged.notes == ()
