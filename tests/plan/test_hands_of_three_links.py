"""The planner with fingers of three links: plans, off the table, repeatable."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.geometry.transforms import apply
from gpis_grasp_planner.grasp.hand_motion import motions_of
from gpis_grasp_planner.hand.drive import reachable
from gpis_grasp_planner.hand.settings import HandSettings
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.surroundings.obstacles import SupportPlane, Surroundings
from gpis_grasp_planner.surroundings.place import Place

SETTINGS = PlannerSettings()


@pytest.fixture(scope="module", params=["three_finger_adaptive", "four_finger_16"])
def planner(request):
    return GraspPlanner(PlannerSettings(hand=HandSettings(model=request.param)))


def request(evaluations: int, **values) -> PlanRequest:
    return PlanRequest(
        time_budget_s=600.0,
        max_evaluations=evaluations,
        n_grasps=6,
        friction=Friction(0.5, 0.5),
        verification="none",
        **values,
    )


@pytest.mark.parametrize(("planner_name", "evaluations"), [("dual", 500), ("paper", 150)])
def test_plans_are_of_the_hand_and_repeat(planner, catalogue, planner_name, evaluations):
    part = catalogue.load("bracket")
    wanted = request(evaluations, seed=1, planner=planner_name)
    first, second = (planner.answer(part, wanted).result for _ in range(2))
    assert first.hand == planner.hand.name
    assert len(first.grasps) >= 3
    poses = [np.array([g.T_object_palm for g in r.grasps]) for r in (first, second)]
    np.testing.assert_array_equal(*poses)
    for grasp in first.grasps:
        q = grasp.recomputed_quality(
            part.center_of_mass, part.max_radius, SETTINGS.search.scene.cone_edges
        )
        assert 0.0 < q.epsilon == pytest.approx(grasp.epsilon, abs=1e-9)
        assert reachable(planner.hand, np.stack([grasp.joints, grasp.pregrasp_joints])).all()


def test_on_a_table_the_whole_way_is_above_the_margin(planner, catalogue):
    """Pre-grasp, closing link after link, closed hand: by the corners of all shapes."""
    part = catalogue.load("coupling_hub")
    height = part.mesh.vertices[:, 2].min()
    support = SupportPlane(np.array([0.0, 0.0, height]), np.array([0.0, 0.0, 1.0]))
    place = Place(surroundings=Surroundings(support, ()))
    grasps = planner.answer(part, request(1000, seed=2), place).result.grasps
    assert grasps
    hand = planner.hand
    motions = motions_of(hand, grasps)
    for T, bow in zip(motions.T, motions.bow, strict=True):
        lowest = min(
            apply(pose[link], piece.vertices)[:, 2].min()
            for pose in T
            for link, pieces in enumerate(hand.link_collision)
            for piece in pieces
        )
        assert bow < 2e-3
        assert lowest - height >= SETTINGS.clearance.margin_m - 1e-6
