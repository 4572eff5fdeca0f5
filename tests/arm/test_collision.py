"""The arm's bodies against what stands around: cases that are known by construction."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from arm_referee import BulletArm
from arm_tables import random_joints
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from gpis_grasp_planner.arm.collision import ArmCollision
from gpis_grasp_planner.arm.description import load_arm
from gpis_grasp_planner.arm.kinematics import link_poses
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.surroundings.obstacles import BoxObstacle, SupportPlane, Surroundings

HAND = load_hand("barrett_bh280")
OPEN = np.zeros(len(HAND.joint_names))
TABLE = SupportPlane(np.zeros(3), np.array([0.0, 0.0, 1.0]), "table")
UP = np.array([[0.0, -1.5708, 0.0, -1.5708, 0.0, 0.0]])
MARGIN = 0.01


def box_mesh(size: float) -> TriangleMesh:
    hull = ConvexHull(size * np.array(list(itertools.product((-0.5, 0.5), repeat=3))))
    return TriangleMesh(hull.points, hull.simplices.astype(np.int32))


def collision(
    around: Surroundings, T_part: NDArray[np.float64] | None = None, name: str = "six_axis"
) -> ArmCollision:
    if T_part is None:
        T_part = np.eye(4)
        T_part[:3, 3] = 5.0
    return ArmCollision(load_arm(name), HAND, around, box_mesh(0.05), T_part, MARGIN)


def test_an_arm_that_points_up_is_free_and_stands_on_its_table() -> None:
    assert collision(Surroundings(TABLE)).first_contact(UP, OPEN, part=True) is None


def test_a_plane_is_met_at_the_margin() -> None:
    # straight up, the lowest of what is held against a support is the second link's ball
    ball = 0.34 - 0.095
    for gap, meets in ((MARGIN + 1e-4, None), (MARGIN - 1e-4, "table")):
        plane = SupportPlane(np.array([0.0, 0.0, ball - gap]), np.array([0.0, 0.0, 1.0]), "table")
        made = collision(Surroundings(plane), name="seven_axis")
        assert made.first_contact(np.zeros((1, 7)), OPEN, part=False) == meets


def test_an_obstacle_is_named_and_the_part_counts_only_where_it_lies() -> None:
    elbow = link_poses(load_arm("six_axis").chain, UP)[0, 3]
    pose = np.eye(4)
    pose[:3, 3] = elbow[:3, 3]
    box = BoxObstacle(pose, np.array([0.1, 0.1, 0.1]), "lamp")
    assert collision(Surroundings(TABLE, (box,))).first_contact(UP, OPEN, part=False) == "lamp"
    beside = collision(Surroundings(TABLE), pose)
    assert beside.first_contact(UP, OPEN, part=True) == "part"
    assert beside.first_contact(UP, OPEN, part=False) is None


def test_a_folded_arm_meets_itself() -> None:
    folded = np.array([[0.0, -1.5708, 3.1, 0.0, 0.0, 0.0]])
    assert collision(Surroundings()).first_contact(folded, OPEN, part=False) is not None


@pytest.mark.parametrize("name", ["six_axis", "seven_axis"])
def test_random_postures_as_pybullet_sees_them(name: str) -> None:
    part = MeshCatalogue([default_catalogue_directory()]).load("mug")
    T_part = np.eye(4)
    T_part[:3, 3] = 0.4, 0.0, 0.05
    arm = load_arm(name)
    ours = {
        shift: ArmCollision(
            arm, HAND, Surroundings(TABLE), part.working_mesh, T_part, MARGIN + shift
        )
        for shift in (-1e-3, 1e-3)
    }
    referee = BulletArm(arm, HAND, part, MARGIN)
    seen = []
    for q in random_joints(name, 120, 11):
        # what both margins agree on is no matter of PyBullet's millimetre
        low, high = (
            made.first_contact(q[None], OPEN, part=True) is not None for made in ours.values()
        )
        if low == high:
            seen.append(low)
            assert bool(referee.touches(q[None], T_part, OPEN)) == low, q
    referee.close()
    assert 10 < sum(seen) < len(seen) - 10
