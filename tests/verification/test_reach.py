"""Which triangles a closing hand may touch, against distances that are computed one by one."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.transforms import apply
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.surface_points import surface_points
from gpis_grasp_planner.verification.reach import FAR, Allowance, Reach


@pytest.mark.parametrize("distance", [0.004, 0.02])
def test_no_triangle_near_the_hand_is_missed(
    bar: Part, hand: HandDescription, firm: Grasp, distance: float
) -> None:
    near = Reach.of(hand, bar.mesh).faces(
        firm.T_object_palm, firm.pregrasp_joints, firm.joints, Allowance(distance, 0.0)
    )
    points = surface_points(hand)
    poses = firm.T_object_palm @ link_transforms(hand, firm.joints[None])[0]
    triangles = bar.mesh.triangles
    weights = np.random.default_rng(0).dirichlet([1, 1, 1], 40)
    samples = np.einsum("sc,fcd->fsd", weights, triangles)
    for link in range(hand.n_links):
        rows = slice(points.offsets[link], points.offsets[link + 1])
        placed = apply(poses[link], points.points[rows])
        gap = np.linalg.norm(samples[:, :, None] - placed[None, None], axis=3).min(axis=(1, 2))
        assert near[gap <= distance].all()


def test_what_is_far_is_left_out(bar: Part, hand: HandDescription, firm: Grasp) -> None:
    far = firm.T_object_palm.copy()
    far[0, 3] += 0.5
    reach = Reach.of(hand, bar.mesh)
    assert not reach.faces(far, firm.pregrasp_joints, firm.joints, FAR).any()
    tree = TriangleTree.of(bar.mesh)
    assert len(tree.triangles) == len(reach.middles)
