"""The camera frames what it is given, as tightly as the margin says."""

import numpy as np
import pytest

from gpis_grasp_planner.hand.link_mesh import convex_hull
from gpis_grasp_planner.view.camera import VIEWS, best_view, look_from
from gpis_grasp_planner.view.renderer import Body, Scene
from gpis_grasp_planner.view.shapes import ellipsoid


def in_picture(camera, points, aspect):
    """Image coordinates (n, 2); the picture is -1..1 in both."""
    R, center = camera.T_world_camera[:3, :3], camera.T_world_camera[:3, 3]
    local = (points - center) @ R
    slope = np.tan(np.radians(camera.fov_deg) / 2)
    assert (local[:, 2] < 0).all()  # before the camera
    return local[:, :2] / -local[:, 2:] / slope / (aspect, 1.0)


@pytest.mark.parametrize("direction", [*VIEWS.values(), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)])
@pytest.mark.parametrize("aspect", [0.5, 4 / 3])
def test_all_points_are_in_the_picture_and_fill_it(direction, aspect, rng):
    points = rng.uniform(-0.1, 0.2, (200, 3)) * (1.0, 2.0, 0.5)
    camera = look_from(direction, points, aspect)
    R = camera.T_world_camera[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    assert R[:, 2] @ direction == pytest.approx(np.linalg.norm(direction))
    image = np.abs(in_picture(camera, points, aspect)).max(axis=0)
    assert image.max() == pytest.approx(1 / 1.06, abs=1e-9)


def test_up_in_the_picture_is_z():
    camera = look_from((1.0, 0.3, 0.2), np.eye(3), 1.0)
    low, high = in_picture(camera, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.5]]), 1.0)
    assert high[1] > low[1]
    assert high[0] == pytest.approx(low[0], abs=0.02)


def test_best_view_looks_at_the_side_where_the_contact_is():
    """A ball before a wall: from behind the wall neither it nor its contact is seen."""
    wall = convex_hull([[x, y, z] for x in (0.0, 0.01) for y in (-1, 1) for z in (-1, 1)])
    ball = convex_hull(
        [[-0.3 + x, y, z] for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1)]
    )
    points = np.vstack([wall.vertices, ball.vertices])
    bodies = [Body(ball, (1.0, 0.5, 0.0)), Body(wall, (0.3, 0.3, 0.3))]
    contact = Body(ellipsoid([-0.4, 0.0, 0.0], [0.05] * 3), (1.0, 0.0, 0.0))
    with Scene([*bodies, contact]) as scene:
        camera = best_view(scene, 1, 2, 1, points, 1.0)
    assert camera.T_world_camera[0, 3] < -1.0
