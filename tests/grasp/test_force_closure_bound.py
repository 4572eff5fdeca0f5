"""The bound refuses what can be seen to have no force closure, and nothing that has."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.grasp.force_closure_bound import has_no_force_closure

RADIUS_M = 0.2


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
