"""The planner with a parallel-jaw gripper: antipodal by an independent test, off the table."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.geometry.transforms import apply, inverse
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.settings import HandSettings
from gpis_grasp_planner.plan.document import read_document, write_document
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.surroundings.obstacles import SupportPlane, Surroundings
from gpis_grasp_planner.surroundings.place import Place

MU = 0.5
SETTINGS = PlannerSettings(hand=HandSettings(model="parallel_jaw"))


@pytest.fixture(scope="module")
def planner():
    return GraspPlanner(SETTINGS)


def request(evaluations: int = 600, **values) -> PlanRequest:
    return PlanRequest(
        time_budget_s=600.0,
        max_evaluations=evaluations,
        n_grasps=6,
        friction=Friction(MU, MU),
        verification="none",
        **values,
    )


def first_touches(triangles: np.ndarray, T_object_palm: np.ndarray, side: float):
    """Where a pad that comes along the jaws' line meets a part first: depths and cosines there.

    Rays on a grid over the pad against all triangles (n, 3, 3): nothing of the planner's is used
    but the palm's pose.
    """
    x, z = np.meshgrid(np.linspace(-0.0105, 0.0105, 22), np.linspace(0.0965, 0.1575, 62))
    corners = apply(inverse(T_object_palm), triangles.reshape(-1, 3)).reshape(-1, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # crossings by signed areas in the plane across the rays
    flat = corners[:, :, [0, 2]]
    across = np.stack([x.ravel(), z.ravel()], axis=1)
    to = flat[:, None] - across[None, :, None]
    areas = np.stack(
        [
            to[..., (k + 1) % 3, 0] * to[..., (k + 2) % 3, 1]
            - to[..., (k + 1) % 3, 1] * to[..., (k + 2) % 3, 0]
            for k in range(3)
        ],
        axis=-1,
    )
    total = areas.sum(axis=-1)
    inside = ((areas * np.sign(total)[..., None]) >= 0.0).all(axis=-1) & (np.abs(total) > 1e-14)
    face, ray = np.nonzero(inside)
    weights = areas[face, ray] / total[face, ray][:, None]
    depth = 0.0425 - side * np.einsum("nk,nk->n", weights, corners[face, :, 1])
    cosine = side * normals[face, 1] / np.linalg.norm(normals[face], axis=1)
    ahead = (depth > 0.0) & (cosine > 0.0)
    assert ahead.any(), "the pad meets nothing"
    return depth[ahead], cosine[ahead]


@pytest.mark.parametrize("mesh_id", ["bracket", "flange"])
def test_answers_are_antipodal(planner, catalogue, mesh_id):
    part = catalogue.load(mesh_id)
    result = planner.answer(part, request(seed=3)).result
    assert len(result.grasps) >= 3
    assert result.hand == "parallel_jaw"
    for grasp in result.grasps:
        assert grasp.epsilon > 0.0
        assert grasp.joints[0] == grasp.joints[1]
        for side in (1.0, -1.0):
            depth, cosine = first_touches(part.mesh.triangles, grasp.T_object_palm, side)
            # the pad stops where it touches first, a little less than a ray's grid tells
            assert grasp.joints[0] == pytest.approx(depth.min(), abs=1.5e-3)
            touching = depth < depth.min() + 2e-4
            assert cosine[touching].max() > 1.0 / np.hypot(1.0, MU)


def test_the_same_plan_twice_and_a_document_that_knows_its_hand(planner, catalogue, tmp_path):
    part = catalogue.load("bracket")
    first, second = (planner.answer(part, request(300, seed=1)).result for _ in range(2))
    poses = [np.array([g.T_object_palm for g in r.grasps]) for r in (first, second)]
    np.testing.assert_array_equal(*poses)
    write_document(tmp_path / "plan.json", first)
    read = read_document(tmp_path / "plan.json").result
    assert read.hand == "parallel_jaw"
    assert read.settings["hand"]["model"] == "parallel_jaw"
    np.testing.assert_array_equal(read.grasps[0].joints, first.grasps[0].joints)


def test_on_a_table_no_corner_of_the_hand_is_below_the_margin(planner, catalogue):
    part = catalogue.load("coupling_hub")
    height = part.mesh.vertices[:, 2].min()
    support = SupportPlane(np.array([0.0, 0.0, height]), np.array([0.0, 0.0, 1.0]))
    place = Place(surroundings=Surroundings(support, ()))
    grasps = planner.answer(part, request(1000, seed=2), place).result.grasps
    assert grasps
    hand = planner.hand
    for grasp in grasps:
        for joints in (grasp.pregrasp_joints, grasp.joints):
            T = grasp.T_object_palm @ link_transforms(hand, joints)[0]
            lowest = min(
                apply(T[link], piece.vertices)[:, 2].min()
                for link, pieces in enumerate(hand.link_collision)
                for piece in pieces
            )
            assert lowest - height >= SETTINGS.clearance.margin_m - 1e-6


def test_an_unknown_hand_is_refused():
    with pytest.raises(RequestError, match="Unknown hand 'claw'"):
        GraspPlanner(PlannerSettings(hand=HandSettings(model="claw")))
