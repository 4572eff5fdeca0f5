"""Pictures with answers known from geometry."""

import numpy as np
import pytest

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.hand.link_mesh import convex_hull
from gpis_grasp_planner.view.corner_normals import corner_normals
from gpis_grasp_planner.view.renderer import Body, Camera, Scene
from gpis_grasp_planner.view.shapes import cylinder

CUBE = convex_hull([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


def shifted(mesh, offset):
    return TriangleMesh(mesh.vertices + offset, mesh.faces)


def rendered(bodies, camera, size=60):
    with Scene(bodies) as scene:
        return scene.render(camera, size, size).astype(int)


@pytest.fixture
def camera():
    """At (0, 0, 10), looking down; at z = 1 the picture is 18 tan(15 deg) high."""
    return Camera(transform(np.eye(3), (0.0, 0.0, 10.0)), 30.0)


def test_coverage_has_the_size_perspective_gives(camera):
    with Scene([Body(CUBE, (1.0, 1.0, 1.0))]) as scene:
        covered = scene.coverage(camera, 400, 400)
    side = 400 * 2.0 / (18.0 * np.tan(np.radians(15.0)))
    assert np.sqrt((covered == 0).sum()) == pytest.approx(side, abs=1.0)
    assert set(np.unique(covered)) == {-1, 0}


def test_the_nearer_body_covers_the_farther(camera):
    near, far = shifted(CUBE, (0.0, 0.0, 3.0)), shifted(CUBE, (1.5, 0.0, -3.0))
    with Scene([Body(far, (1.0, 0.0, 0.0)), Body(near, (0.0, 1.0, 0.0))]) as scene:
        covered = scene.coverage(camera, 100, 100)
    assert covered[50, 50] == 1
    assert (covered == 0).any()


def test_a_marker_shows_through_and_changes_nothing_else(camera):
    cube = Body(CUBE, (0.2, 0.2, 0.2))
    before = rendered([cube], camera)
    behind = rendered([cube, Body(shifted(CUBE, (0.0, 0.0, -4.0)), (1.0, 0.0, 0.0), True)], camera)
    small = TriangleMesh(0.5 * CUBE.vertices + (0.0, 0.0, 4.0), CUBE.faces)
    before_it = rendered([cube, Body(small, (1.0, 0.0, 0.0), True)], camera)
    redness = [(image[30, 30] @ (2, -1, -1)).item() for image in (before, behind, before_it)]
    assert redness[0] < 50 < redness[1] < redness[2] - 50
    np.testing.assert_array_equal(behind[:10, :10], before[:10, :10])


def test_more_triangles_than_a_shape_takes_are_all_drawn(camera):
    """50,000 triangles, of which the last are those that are seen."""
    grain = TriangleMesh(1e-3 * CUBE.vertices, CUBE.faces)
    hidden = [shifted(grain, (x, 0.0, -0.5)) for x in np.linspace(-0.5, 0.5, 4000)]
    meshes = [*hidden, CUBE]
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    whole = TriangleMesh(
        np.vstack([mesh.vertices for mesh in meshes]),
        np.vstack([mesh.faces + n for mesh, n in zip(meshes, first, strict=False)]),
    )
    assert len(whole.faces) > 45_000
    with Scene([Body(whole, (1.0, 0.5, 0.0))]) as scene:
        covered = scene.coverage(camera, 60, 60)
    with Scene([Body(CUBE, (1.0, 0.5, 0.0))]) as scene:
        np.testing.assert_array_equal(covered, scene.coverage(camera, 60, 60))


def test_an_empty_scene_is_background(camera):
    image = rendered([], camera)
    assert image.min() > 200


def test_edges_stay_sharp_and_round_sides_become_smooth():
    np.testing.assert_allclose(
        corner_normals(CUBE), np.repeat(CUBE.face_normals_outward[:, None], 3, axis=1), atol=1e-12
    )
    pipe = cylinder(np.eye(4), 1.0, 2.0)
    normals, corners = corner_normals(pipe), pipe.vertices[pipe.faces]
    side = np.abs(pipe.face_normals_outward[:, 2]) < 0.5
    radial = corners[side] * (1.0, 1.0, 0.0)
    cosine = np.einsum("fci,fci->fc", normals[side], radial)
    assert cosine.min() > np.cos(np.radians(6.0))
    np.testing.assert_allclose(np.abs(normals[~side][..., 2]), 1.0, atol=1e-12)
