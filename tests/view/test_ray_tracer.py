"""Rays and light with answers known from geometry."""

import numpy as np
import pytest

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.hand.link_mesh import convex_hull
from gpis_grasp_planner.view.ray_tracer import Body, Camera, Scene
from gpis_grasp_planner.view.soft_light import smooth_light

CUBE = convex_hull([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


def shifted(mesh, offset):
    return TriangleMesh(mesh.vertices + offset, mesh.faces)


@pytest.fixture
def camera():
    """At (0, 0, 10), looking down; at z = 1 the picture is 18 tan(15 deg) high."""
    return Camera(transform(np.eye(3), (0.0, 0.0, 10.0)), 30.0)


def test_coverage_has_the_size_perspective_gives(camera):
    covered = Scene([Body(CUBE, (1.0, 1.0, 1.0))]).coverage(camera, 400, 400)
    side = 400 * 2.0 / (18.0 * np.tan(np.radians(15.0)))
    assert np.sqrt((covered == 0).sum()) == pytest.approx(side, abs=1.0)
    assert set(np.unique(covered)) == {-1, 0}


def test_the_nearer_body_covers_the_farther(camera):
    near, far = shifted(CUBE, (0.0, 0.0, 3.0)), shifted(CUBE, (0.5, 0.0, -3.0))
    scene = Scene([Body(far, (1.0, 0.0, 0.0)), Body(near, (0.0, 1.0, 0.0))])
    covered = scene.coverage(camera, 100, 100)
    assert covered[50, 50] == 1
    np.testing.assert_array_equal(
        scene.visible(camera, [[0.0, 0.0, 4.0], [0.0, 0.0, -2.0]], 0.01), [True, False]
    )


def test_a_marker_shows_through_and_casts_no_shadow(camera):
    ball = shifted(CUBE, (0.0, 0.0, -4.0))
    plain = Scene([Body(CUBE, (0.2, 0.2, 0.2))])
    marked = Scene([Body(CUBE, (0.2, 0.2, 0.2)), Body(ball, (1.0, 0.0, 0.0), marker=True)])
    before, after = plain.render(camera, 60, 60).astype(int), marked.render(camera, 60, 60)
    assert after[30, 30, 0] > before[30, 30, 0] + 50
    corner = before[:10, :10]
    np.testing.assert_array_equal(after[:10, :10], corner)


def test_smooth_light_removes_grain_but_keeps_edges(rng):
    normal = np.zeros((40, 40, 3), dtype=np.float32)
    normal[:, :20, 0] = normal[:, 20:, 2] = 1.0  # two faces at a right angle
    clean = np.where(np.arange(40) < 20, 0.2, 0.8)[None, :, None] * np.ones((40, 1, 1))
    grainy = (clean + 0.1 * rng.standard_normal((40, 40, 1))).astype(np.float32)
    seen = np.ones((40, 40), dtype=bool)
    smooth = smooth_light(grainy, normal, np.ones((40, 40), dtype=np.float32), seen, 0.01)
    assert np.abs(smooth - clean).std() < 0.4 * np.abs(grainy - clean).std()
    assert smooth[:, :20].max() < 0.5 < smooth[:, 20:].min()


def test_unseen_pixels_take_their_neighbours_light():
    light = np.full((9, 9, 1), 0.7, dtype=np.float32)
    seen = np.ones((9, 9), dtype=bool)
    seen[4, 4], light[4, 4] = False, 0.0
    normal = np.zeros((9, 9, 3), dtype=np.float32)
    normal[..., 2] = seen
    smooth = smooth_light(light, normal, np.ones((9, 9), dtype=np.float32), seen, 0.01)
    np.testing.assert_allclose(smooth, 0.7, atol=1e-6)
