"""The nearest point of one triangle against another library and against its own optimality."""

import numpy as np
import pytest
from trimesh.triangles import closest_point

from gpis_grasp_planner.geometry.triangle_distance import nearest_on_triangle


def nearest(p, triangle):
    out = np.empty(3)
    squared, inside = nearest_on_triangle(*p, np.ascontiguousarray(triangle)[None], 0, out)
    return out, squared, inside


@pytest.mark.parametrize("sharpness", [1.0, 1e-3])
def test_it_is_that_of_trimesh(rng, sharpness):
    triangles = rng.normal(size=(3000, 3, 3)) * [1.0, 1.0, sharpness]
    points = 2.0 * rng.normal(size=(3000, 3))
    expected = closest_point(triangles, points)
    found = [nearest(p, t) for p, t in zip(points, triangles, strict=True)]
    np.testing.assert_allclose([q for q, _, _ in found], expected, atol=1e-9)
    distance = np.linalg.norm(points - expected, axis=1)
    np.testing.assert_allclose(np.sqrt([d2 for _, d2, _ in found]), distance, rtol=1e-9)


def test_inside_the_face_means_along_the_normal(rng):
    kinds = np.zeros(2, dtype=int)
    for _ in range(500):
        triangle, p = rng.normal(size=(3, 3)), rng.normal(size=3)
        q, _, inside = nearest(p, triangle)
        a, b, c = triangle
        along = np.abs(np.array([b - a, c - a]) @ (p - q)).max()
        assert (along < 1e-9) == inside
        kinds[int(inside)] += 1
    assert kinds.min() > 50


def test_a_triangle_without_area_gives_a_point_of_it():
    p = np.array([0.3, 1.0, 0.0])
    segment = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    q, squared, inside = nearest(p, segment)
    np.testing.assert_allclose(q, [0.3, 0.0, 0.0], atol=1e-15)
    assert (squared, inside) == (1.0, False)
    q, squared, inside = nearest(p, np.zeros((3, 3)))
    np.testing.assert_array_equal(q, 0.0)
    assert (squared, inside) == (pytest.approx(1.09), False)
