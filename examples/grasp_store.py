"""Keep plans on disk: the second question is answered without a search.

python grasp_store.py [FILE]
"""

import sys
import time
from pathlib import Path

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.store.answering import answer_with_store
from gpis_grasp_planner.store.grasp_store import GraspStore

store = GraspStore(Path(sys.argv[1] if len(sys.argv) > 1 else "grasps.sqlite"))
planner = GraspPlanner()
part = MeshCatalogue([default_catalogue_directory()]).load("phone")
for _ in range(2):
    start = time.monotonic()
    stored = answer_with_store(planner, store, part, PlanRequest(time_budget_s=3.0))
    print(
        f"{len(stored.answer.result.grasps)} grasps in {time.monotonic() - start:.2f} s, "
        f"from the store: {stored.from_store}"
    )
for entry in store.entries():
    print(f"kept: {entry.mesh_id}, {entry.n_grasps} grasps, best epsilon {entry.best_epsilon:.3f}")
