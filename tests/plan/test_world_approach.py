"""A wanted direction of the world, for a part that is turned and has nothing around it."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.surroundings.approach_cone import ApproachCone
from gpis_grasp_planner.surroundings.place import Place


def test_a_turned_part_in_free_space_is_approached_from_above() -> None:
    part = MeshCatalogue([default_catalogue_directory()]).load("mug")
    T_world_object = np.eye(4)
    T_world_object[:3, :3] = Rotation.from_euler("xy", [100.0, 30.0], degrees=True).as_matrix()
    down = ApproachCone(np.array([0.0, 0.0, -1.0]), 25.0)
    request = PlanRequest(
        seed=4, n_grasps=5, max_evaluations=600, time_budget_s=300.0, approach=down
    )
    result = GraspPlanner().answer(part, request, Place(T_world_object)).result
    assert result.grasps
    for grasp in result.grasps:
        cosine = -(T_world_object @ grasp.T_object_palm)[2, 2]
        assert np.degrees(np.arccos(cosine)) <= 25.0 + 1e-6
    # The document has the pose that the direction needs.
    assert np.allclose(Place.from_mapping(result.place).T_world_object, T_world_object)
