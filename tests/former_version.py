"""Plans for parts on a table as another checkout of this project does it: search, then filter.

    PYTHONPATH=CHECKOUT/ros2_ws/src/gpis_grasp_planner python tests/former_version.py CASE.json

Reads a case (mesh, mass, support, budget) and prints the answered grasps as JSON. For versions
that have `placing.plan_at`, which plans in free space and keeps what is clear of the table.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.placing import plan_at
from gpis_grasp_planner.planner import GraspPlanner
from gpis_grasp_planner.planning.obstacles import SupportPlane, Surroundings
from gpis_grasp_planner.planning.place import Place
from gpis_grasp_planner.planning.request import PlanRequest


def main() -> None:
    """Answer one case."""
    case = json.loads(Path(sys.argv[1]).read_text())
    mesh = TriangleMesh(np.array(case["vertices"]), np.array(case["faces"], dtype=np.int32))
    center = np.array(case["center_of_mass"])
    friction = Friction(*case["friction"]) if case["friction"] else None
    part = Part(case["part"], mesh, center, case["mass"], case["volume"], True, friction)
    planner = GraspPlanner()
    warm = PlanRequest(time_budget_s=0.5, max_evaluations=50)
    planner.plan(part, warm)  # loads the compiled code
    up = np.array(case["up"])
    place = Place(surroundings=Surroundings(SupportPlane(up * case["height"], up)))
    request = PlanRequest(
        time_budget_s=case["budget_s"], seed=case["seed"], verification=case["verification"]
    )
    start = time.monotonic()
    _, answer = plan_at(planner, part, request, place)
    grasps = [
        {
            "T_object_palm": grasp.T_object_palm.tolist(),
            "joints": grasp.joints.tolist(),
            "pregrasp_joints": grasp.pregrasp_joints.tolist(),
            "approach_direction": grasp.approach_direction.tolist(),
            "approach_distance": grasp.approach_distance,
            "epsilon": grasp.epsilon,
            "held": bool(grasp.trials is not None and grasp.trials.held),
        }
        for grasp in answer.result.grasps
    ]
    spent = time.monotonic() - start
    result = answer.result
    said = {"code": result.code.name, "message": result.message, "elapsed_s": round(spent, 3)}
    json.dump({**said, "grasps": grasps}, sys.stdout)


if __name__ == "__main__":
    main()
