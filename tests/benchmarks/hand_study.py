"""A hand on the shipped parts: whether the first grasp answered holds in both engines.

    python tests/benchmarks/hand_study.py --hand parallel_jaw --time 10

prints a row for each part. The verdicts printed are of
trials made again, in each engine.
"""

from __future__ import annotations

import argparse

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.hand.settings import HandSettings
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.verification.protocol import verify
from gpis_grasp_planner.verification.settings import VerificationSettings

ENGINES = ("bullet", "mujoco")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hand", default="parallel_jaw")
    parser.add_argument("--time", type=float, default=10.0, help="s for each part")
    parser.add_argument("--friction", type=float, default=0.6)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("parts", nargs="*")
    chosen = parser.parse_args()
    catalogue = MeshCatalogue([default_catalogue_directory()])
    planner = GraspPlanner(PlannerSettings(hand=HandSettings(model=chosen.hand)))
    held = dict.fromkeys(ENGINES, 0)
    names = chosen.parts or catalogue.ids()
    for name in names:
        part = catalogue.load(name)
        request = PlanRequest(
            time_budget_s=chosen.time,
            n_grasps=4,
            friction=Friction(chosen.friction, chosen.friction),
            seed=chosen.seed,
            verification="rank",
        )
        result = planner.answer(part, request).result
        row = [name, result.code.name, f"{result.elapsed_s:.1f} s"]
        if result.grasps:
            first = result.grasps[0]
            row.append(f"epsilon {first.epsilon:.3f}")
            row.append("not tried" if first.trials is None else f"held {first.trials.held}")
            for engine in ENGINES:
                settings = VerificationSettings(engine=engine, friction=chosen.friction)
                [verdict] = verify(part, planner.hand, [first], settings)
                held[engine] += verdict.held
                row.append(f"{engine} {verdict.cause or 'held'} {verdict.largest_slip_mm:.1f} mm")
        print(", ".join(row), flush=True)
    print(", ".join(f"{engine}: {n} of {len(names)} held" for engine, n in held.items()))


if __name__ == "__main__":
    main()
