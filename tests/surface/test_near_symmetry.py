"""Near symmetries of solids whose symmetries are known."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.surface.atlas import SurfaceAtlas
from gpis_grasp_planner.surface.implicit_surface import fit_part
from gpis_grasp_planner.surface.near_symmetry import near_symmetries


def symmetries_of(solid, tolerance=0.05, **options):
    """Near symmetries of a trimesh solid, its centre and its largest radius."""
    mesh = TriangleMesh(np.array(solid.vertices), np.array(solid.faces, np.int32))
    center = np.array(solid.center_mass)
    radius = np.linalg.norm(solid.vertices - center, axis=1).max()
    atlas = SurfaceAtlas(fit_part(mesh))
    return near_symmetries(atlas, center, radius, tolerance, **options), center, radius


def axes_of(symmetries, reflection):
    """Normals of the planes, or axes of the half-turns, (n, 3)."""
    sign = -1.0 if reflection else 1.0
    own = [s for s in symmetries if s.is_reflection == reflection and not is_inversion(s)]
    return np.array(
        [np.linalg.eigh(sign * s.T_image_object[:3, :3])[1][:, -1] for s in own]
    ).reshape(-1, 3)


def is_inversion(symmetry):
    return np.allclose(symmetry.T_image_object[:3, :3], -np.eye(3))


def box(*extents):
    return trimesh.creation.box(extents).subdivide().subdivide()


def test_a_box_has_three_planes_three_half_turns_and_its_centre():
    solid = box(0.06, 0.09, 0.14)
    found, _, _ = symmetries_of(solid)
    assert [s.residual for s in found] == sorted(s.residual for s in found)
    assert len(found) == 7
    assert sum(is_inversion(s) for s in found) == 1
    for reflection in (True, False):
        axes = axes_of(found, reflection)
        assert len(axes) == 3
        assert_allclose(np.sort(np.abs(axes), axis=0)[-1], 1.0, atol=1e-3)
        assert_allclose(np.abs(axes @ axes.T), np.eye(3), atol=1e-2)


def test_the_maps_go_about_the_centre_of_mass_wherever_it_lies(rng):
    R = Rotation.random(rng=rng).as_matrix()
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, [0.3, -0.2, 0.1]
    solid = box(0.06, 0.09, 0.14)
    solid.apply_transform(T)
    found, center, _ = symmetries_of(solid)
    assert_allclose(center, T[:3, 3], atol=1e-9)
    planes = axes_of(found, True)
    assert len(planes) == 3
    # Every axis of the turned box is one of the normals.
    assert_allclose(np.abs(planes @ R).max(axis=0), 1.0, atol=5e-3)
    for symmetry in found:
        image = symmetry.T_image_object @ np.append(center, 1.0)
        assert_allclose(image[:3], center, atol=1e-12)
        R_image = symmetry.T_image_object[:3, :3]
        assert_allclose(R_image @ R_image, np.eye(3), atol=1e-12)
        assert symmetry.is_reflection == (np.linalg.det(R_image) < 0.0)


def test_a_cone_has_planes_all_around_its_axis_and_no_other():
    solid = trimesh.creation.cone(0.04, 0.1, sections=64)
    found, _, _ = symmetries_of(solid, tolerance=0.03)
    planes = axes_of(found, True)
    assert len(planes) >= 8
    assert_allclose(planes[:, 2], 0.0, atol=0.05)
    assert len(axes_of(found, False)) == 1, "a cone has no half-turn but about its axis"
    assert not any(is_inversion(s) for s in found)
    # No two of them are alike.
    cosines = np.abs(planes @ planes.T) - np.eye(len(planes))
    assert cosines.max() < np.cos(np.deg2rad(7.0))


def test_a_ball_has_as_many_as_are_asked_for():
    solid = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    for most in (7, 24):
        found, _, _ = symmetries_of(solid, most=most)
        assert len(found) == most


def test_a_lopsided_part_has_none():
    rng = np.random.default_rng(3)
    solid = trimesh.convex.convex_hull(
        np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.07, 0], [0.02, 0.01, 0.05], [0.03, 0.06, 0.04]])
        + 0.002 * rng.random((5, 3))
    )
    found, _, _ = symmetries_of(solid, tolerance=0.02)
    assert found == ()


@pytest.mark.parametrize("height", [0.0, 0.01, 0.03])
def test_a_bump_costs_the_symmetries_that_it_breaks(height):
    """A plate with a bump at +x, +z: only the plane across y leaves it where it is."""
    solid = box(0.12, 0.06, 0.03)
    if height:
        bump = trimesh.creation.box((0.04, 0.06, height))
        bump.apply_translation([0.04, 0.0, 0.015 + height / 2.0])
        solid = trimesh.boolean.union([solid, bump]).subdivide().subdivide()
    found, _, _ = symmetries_of(solid, tolerance=1.0)
    residual = {
        axis: min(
            s.residual
            for s, normal in zip(
                [s for s in found if s.is_reflection and not is_inversion(s)],
                axes_of(found, True),
                strict=True,
            )
            if abs(normal[axis]) > 0.95
        )
        for axis in range(3)
    }
    assert residual[1] < 0.03
    if height == 0.0:
        assert max(residual.values()) < 0.03
    if height == 0.03:
        assert residual[0] > 0.04
        assert residual[2] > 0.04
