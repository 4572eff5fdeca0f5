"""The bound refuses what can be seen to have no force closure, and nothing that has."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.grasp.force_closure_bound import (
    has_no_force_closure,
    is_only_pressed_down,
)

RADIUS_M = 0.2
GAP_M = 2e-4


def mesh_of(solid: trimesh.Trimesh) -> TriangleMesh:
    return TriangleMesh(np.array(solid.vertices), np.array(solid.faces, dtype=np.int32))


def refused(solid: trimesh.Trimesh, friction: float) -> bool:
    mesh = mesh_of(solid)
    return has_no_force_closure(mesh, np.arange(len(mesh.faces)), RADIUS_M, friction)


def test_a_large_box_is_refused_up_to_the_friction_of_its_corner() -> None:
    """Three faces of a corner make asin(1 / sqrt 3) with its diagonal: friction tan of that."""
    corner = np.tan(np.arcsin(1.0 / np.sqrt(3.0)))
    box = trimesh.creation.box([1.2, 1.2, 1.2])
    assert refused(box, 0.98 * corner)
    assert not refused(box, 1.02 * corner)


def test_a_large_ball_is_refused() -> None:
    assert refused(trimesh.creation.icosphere(3, 0.6), 0.5)


@pytest.mark.parametrize(
    "solid",
    [
        trimesh.creation.box([0.39, 1.5, 1.5]),
        trimesh.creation.box([1.0, 1.0, 0.01]),
        trimesh.creation.cylinder(0.19, 2.0),
        trimesh.creation.torus(0.8, 0.03),
        trimesh.creation.box([0.05, 0.05, 0.05]),
    ],
    ids=["slab", "sheet", "column", "ring", "block"],
)
def test_what_has_opposed_faces_within_the_ball_is_not_refused(solid: trimesh.Trimesh) -> None:
    assert not refused(solid, 0.3)


def test_turning_the_part_changes_nothing() -> None:
    box = trimesh.creation.box([0.8, 0.8, 0.8])
    box.apply_transform(trimesh.transformations.random_rotation_matrix(np.array([0.2, 0.7, 0.4])))
    assert refused(box, 0.5)


def test_no_faces_at_all_have_no_grasp_and_one_face_has_none() -> None:
    mesh = mesh_of(trimesh.creation.box([0.1, 0.1, 0.1]))
    assert has_no_force_closure(mesh, np.arange(0), RADIUS_M, 0.5)
    assert has_no_force_closure(mesh, np.arange(2), RADIUS_M, 0.5)


def test_out_of_time_nothing_is_refused() -> None:
    mesh = mesh_of(trimesh.creation.box([1.2, 1.2, 1.2]))
    assert not has_no_force_closure(
        mesh, np.arange(len(mesh.faces)), RADIUS_M, 0.5, late=lambda: True
    )


def pressed_down(solid: trimesh.Trimesh, friction: float, margin_mm: float) -> bool:
    mesh = mesh_of(solid)
    heights = mesh.vertices[:, 2] - mesh.vertices[:, 2].min()
    up = np.array([0.0, 0.0, 1.0])
    return is_only_pressed_down(mesh, up, heights, friction, 1e-3 * margin_mm, GAP_M)


@pytest.mark.parametrize("friction", [0.2, 0.6, 1.0])
def test_a_ball_is_only_pressed_down_where_its_cap_is_within_the_friction_angle(friction) -> None:
    """What is touched over m - g sin is a cap whose rim has a rise of (m - g sin - r) / r."""
    r, sine = 2e-3, np.sin(np.arctan(friction))
    ball = trimesh.creation.icosphere(5, r)
    margin = r + r * sine + GAP_M * sine
    facet = 2e-4  # the ball is faceted
    assert pressed_down(ball, friction, 1e3 * (margin + facet))
    assert not pressed_down(ball, friction, 1e3 * (margin - facet))


def test_a_box_is_only_pressed_down_where_none_of_its_sides_is_reached() -> None:
    box = trimesh.creation.box([0.05, 0.02, 0.0028])
    assert pressed_down(box, 0.6, 3.0)
    assert not pressed_down(box, 0.6, 2.8)
    turned = box.copy()
    turned.apply_transform(trimesh.transformations.rotation_matrix(0.6, [0, 0, 1]))
    assert pressed_down(turned, 0.6, 3.0)


def test_no_touch_that_presses_sideways_or_up_is_possible_where_it_says_so(rng) -> None:
    """Brute force: hand points off random places of refused lenses, over the margin."""
    refused_parts = 0
    for _ in range(40):
        friction, margin = rng.uniform(0.2, 1.0), 3e-3
        lens = trimesh.creation.icosphere(3, 1.0)
        lens.apply_scale(rng.uniform(1.3e-3, [6e-3, 6e-3, 3e-3]))
        lens.apply_transform(
            trimesh.transformations.rotation_matrix(0.3 * rng.normal(), [1.0, 0.0, 0.0])
        )
        lowest = lens.vertices[:, 2].min()
        if not pressed_down(lens, friction, 1e3 * margin):
            continue
        refused_parts += 1
        points, faces = trimesh.sample.sample_surface(lens, 4000, seed=int(rng.integers(2**31)))
        normals = lens.face_normals[faces]
        hand = points + rng.uniform(0.0, GAP_M, (len(points), 1)) * normals
        touches = hand[:, 2] - lowest >= margin
        assert (normals[touches, 2] > np.sin(np.arctan(friction))).all()
    assert refused_parts >= 5
