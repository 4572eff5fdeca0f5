"""The way of the open hand past the part: nothing of the part is between two looks at it."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.grasp.funnel import Loss
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.plan.placed_grasps import GraspPlacing
from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.quality.figures import Quality
from gpis_grasp_planner.surroundings.clearance import Clearance
from gpis_grasp_planner.surroundings.clearance_settings import ClearanceSettings
from gpis_grasp_planner.surroundings.obstacles import Surroundings
from gpis_grasp_planner.surroundings.way_past_part import meets_part_on_approach

HAND = load_hand("barrett_bh280")


def tetrahedron(middle, size):
    """A small solid about a point (3,) [m]."""
    corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    return TriangleTree.of(TriangleMesh(np.asarray(middle) + size * corners, faces))


@pytest.fixture
def grasp():
    """A hand at the origin that came along z from 100 mm farther back."""
    joints = np.zeros(len(HAND.joint_names))
    return Grasp(
        T_object_palm=np.eye(4),
        joints=joints,
        pregrasp_joints=joints,
        contacts=Contacts.none(),
        quality=Quality(0.1, 0.1),
        approach_direction=np.array([0.0, 0.0, 1.0]),
        approach_distance=0.1,
    )


@pytest.mark.parametrize(
    ("middle", "meets"),
    [
        ((0.0, 0.0, -0.025), True),  # behind the palm, between two sixths of the way
        ((0.0, 0.0, -0.098), True),
        ((0.0, 0.0, -0.105), False),  # farther back than the hand ever was
        ((0.2, 0.0, -0.025), False),  # beside it
        ((0.0, 0.0, 0.12), False),  # before it, where a part belongs
        ((0.0, 0.0, 0.07), True),  # in the palm itself
    ],
)
def test_a_speck_of_a_millimetre_is_not_missed(grasp, middle, meets):
    found = meets_part_on_approach(HAND, [grasp], tetrahedron(middle, 5e-4))
    assert found.tolist() == [meets]


def test_none_are_none():
    assert len(meets_part_on_approach(HAND, [], tetrahedron((0, 0, 1), 1e-3))) == 0


@pytest.mark.parametrize("z", [-0.025, -0.2])
def test_a_hand_that_comes_through_the_part_is_not_clear(grasp, z):
    tree = tetrahedron((0.0, 0.0, z), 5e-4)
    placing = GraspPlacing(HAND, Surroundings(), ClearanceSettings(pregrasp="open"), tree)
    _, [clearance] = placing.finished([grasp], [Clearance(np.inf)])
    assert clearance.cause == (str(Loss.WAY_BACK) if z == -0.025 else None)
