"""Declared symmetries: the group, the pose that stands for its like, and false declarations."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.symmetry import SymmetryGroup, Turn
from gpis_grasp_planner.geometry.transforms import transform

Z, X = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
POINT = np.array([0.02, -0.01, 0.03])


def turn(axis: np.ndarray, order: int, point: np.ndarray = POINT) -> Turn:
    return Turn(2.0 * np.pi / order * axis, point)


def free(axis: np.ndarray, point: np.ndarray = POINT) -> Turn:
    return Turn(axis, point, any_angle=True)


def random_pose(rng: np.random.Generator) -> np.ndarray:
    return transform(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3))


@pytest.mark.parametrize(
    ("turns", "n"),
    [
        ([], 1),
        ([turn(Z, 6)], 6),
        ([turn(Z, 2), turn(X, 2)], 4),  # a box
        ([turn(Z, 4), turn(X, 4)], 24),  # a cube
        ([free(Z), turn(X, 2)], 2),  # a cylinder
    ],
)
def test_a_group_has_all_products(turns: list[Turn], n: int) -> None:
    matrices = SymmetryGroup(turns).matrices
    assert len(matrices) == n
    np.testing.assert_array_equal(matrices[0], np.eye(4))
    for one in matrices:
        np.testing.assert_allclose(one[:3, :3] @ POINT + one[:3, 3], POINT, atol=1e-12)
        for other in matrices:
            assert np.isclose(one @ other, matrices, atol=1e-6).all(axis=(1, 2)).any()


def equal_poses(group: SymmetryGroup, T: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    poses = [T @ S for S in group.matrices]
    if group.axis is not None:
        poses += [T @ S @ group.axis.matrix(rng.uniform(-4, 4)) for S in group.matrices]
    return poses


GROUPS = {
    "gear": [turn(Z, 6)],
    "box": [turn(Z, 2), turn(X, 2)],
    "cube": [turn(Z, 4), turn(X, 4)],
    "shaft": [free(Z)],
    "cylinder": [free(X), turn(Z, 2)],
}


@pytest.mark.parametrize("name", GROUPS)
def test_equal_poses_have_one_that_stands_for_all(name: str, rng: np.random.Generator) -> None:
    group = SymmetryGroup(GROUPS[name])
    for _ in range(20):
        T = random_pose(rng)
        chosen = [group.chosen(each) for each in equal_poses(group, T, rng)]
        np.testing.assert_allclose(
            chosen, np.broadcast_to(chosen[0], (len(chosen), 4, 4)), atol=1e-9
        )
        # ... and it is one of them: a turn of the group leads to it.
        S = np.linalg.solve(T, chosen[0])
        if group.axis is None:
            assert np.isclose(S, group.matrices, atol=1e-9).all(axis=(1, 2)).any()
        else:
            axis = group.axis.rotvec
            assert abs(abs(axis @ S[:3, :3] @ axis) - 1.0) < 1e-9
            np.testing.assert_allclose(S[:3, :3] @ POINT + S[:3, 3], POINT, atol=1e-9)


@pytest.mark.parametrize("name", GROUPS)
def test_lying_the_same_way_is_the_same_place_whatever_the_heading(
    name: str, rng: np.random.Generator
) -> None:
    group = SymmetryGroup(GROUPS[name])
    for _ in range(20):
        T = random_pose(rng)
        ups = []
        for heading in rng.uniform(-np.pi, np.pi, 6):
            S = group.matrices[rng.integers(len(group.matrices))]
            if group.axis is not None:
                S = S @ group.axis.matrix(rng.uniform(-4, 4))
            about = transform(Rotation.from_rotvec(heading * Z).as_matrix(), np.zeros(3))
            ups.append(group.chosen(about @ T @ S)[2, :3])
        assert np.linalg.norm(np.array(ups) - ups[0], axis=1).max() < 0.02


def test_an_upright_axis_is_turned_least_against_the_world(rng: np.random.Generator) -> None:
    group = SymmetryGroup([free(Z, np.zeros(3))])
    for angle in rng.uniform(-3, 3, 10):
        T = transform(Rotation.from_rotvec(angle * Z).as_matrix(), [0.3, 0.0, 0.1])
        np.testing.assert_allclose(
            group.chosen(T), transform(np.eye(3), [0.3, 0.0, 0.1]), atol=1e-9
        )


def mesh_of(shape: trimesh.Trimesh) -> TriangleMesh:
    return TriangleMesh(np.asarray(shape.vertices), np.asarray(shape.faces, dtype=np.int64))


def test_what_is_declared_is_looked_at() -> None:
    box = mesh_of(trimesh.creation.box((0.04, 0.04, 0.1)))
    rod = mesh_of(trimesh.creation.cylinder(0.02, 0.1, sections=48))
    origin = np.zeros(3)
    for mesh, turns, good in (
        (box, [turn(Z, 4, origin)], True),
        (box, [turn(Z, 4, origin), turn(X, 2, origin)], True),
        (box, [turn(Z, 6, origin)], False),
        (box, [turn(X, 4, origin)], False),
        (box, [turn(Z, 4, np.array([0.01, 0.0, 0.0]))], False),
        (box, [free(Z, origin)], False),
        (rod, [free(Z, origin)], True),
        (rod, [free(X, origin)], False),
    ):
        off, limit = SymmetryGroup(turns).deviation(mesh)
        assert (off <= limit) == good, (turns, off, limit)


@pytest.mark.parametrize(
    "turns",
    [
        [free(Z), free(X)],
        [free(Z), turn(X, 4)],
        [free(Z), turn(X, 2, POINT + 0.01)],
        [Turn(np.array([0.0, 0.0, 0.0123]), POINT), turn(X, 7)],
    ],
)
def test_what_no_body_has_is_refused(turns: list[Turn]) -> None:
    with pytest.raises(ValueError, match=r"any|more than 360"):
        SymmetryGroup(turns)
