"""Depth and bodies of a shot are those of the geometry."""

import numpy as np
import pytest

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.scene.bullet_camera import BulletCamera

FOV_DEG = 40.0


@pytest.fixture
def camera():
    with BulletCamera() as made:
        yield made


def test_depth_of_a_slanted_triangle(camera, rng):
    """Along the camera's axis, at every pixel: the plane is known."""
    corners = np.array([[[-9.0, -9.0, -1.0], [9.0, -9.0, 1.0], [0.0, 9.0, 0.0]]])
    normal = np.cross(corners[0, 1] - corners[0, 0], corners[0, 2] - corners[0, 0])
    normal /= np.linalg.norm(normal)
    camera.add(corners, np.tile(normal, (1, 3, 1)), (1.0, 0.0, 0.0))
    T = transform(np.eye(3), (0.0, 0.0, 5.0))
    shot = camera.shot(T, FOV_DEG, 80, 60)
    assert (shot.body == 0).all()
    slope = np.tan(np.radians(FOV_DEG) / 2.0)
    x = ((np.arange(80) + 0.5) / 40.0 - 1.0) * slope * 80 / 60
    y = (1.0 - (np.arange(60) + 0.5) / 30.0) * slope
    rays = np.stack([*np.meshgrid(x, y), np.full((60, 80), -1.0)], axis=-1)
    expected = normal @ (corners[0, 0] - T[:3, 3]) / (rays @ normal)
    np.testing.assert_allclose(shot.depth, expected, atol=0.02)


def test_what_is_nowhere_has_no_depth(camera):
    shot = camera.shot(np.eye(4), FOV_DEG, 8, 6)
    assert (shot.body == -1).all()
    assert np.isinf(shot.depth).all()


def test_a_facing_triangle_is_brighter_than_one_that_turns_away(camera):
    """And of its colour."""
    corners = np.array([[[-9.0, -9.0, 0.0], [9.0, -9.0, 0.0], [0.0, 9.0, 0.0]]])
    T = transform(np.eye(3), (0.0, 0.0, 5.0))
    camera.add(corners, np.tile([0.0, 0.0, 1.0], (1, 3, 1)), (0.2, 0.8, 0.2))
    facing = camera.shot(T, FOV_DEG, 8, 6).pixels[3, 4].astype(int)
    with BulletCamera() as other:
        other.add(corners, np.tile([1.0, 0.0, 0.0], (1, 3, 1)), (0.2, 0.8, 0.2))
        turned = other.shot(T, FOV_DEG, 8, 6).pixels[3, 4].astype(int)
    assert facing[1] > turned[1] + 20
    assert facing[1] > 3 * facing[0] == 3 * facing[2]
