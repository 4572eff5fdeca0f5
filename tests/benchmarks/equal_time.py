"""The best epsilon at equal wall time, of this version and a former one: a guard of quality.

    python tests/benchmarks/equal_time.py --time 3 --seeds 3

Both versions plan every shipped part with every seed in turn, the order changed from one plan to
the next, in two processes of which one waits for the other. Surfaces and fields come from memory:
each part is planned once before, for 20 attempts. No place, no trials.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys

from two_versions import FORMER, ROOT, Server, former_tree


def serve() -> None:
    """Plan for every line of standard input: part, seed and seconds; print what was found."""
    from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
    from gpis_grasp_planner.plan.planner import GraspPlanner
    from gpis_grasp_planner.plan.request import PlanRequest

    catalogue, planner = MeshCatalogue([default_catalogue_directory()]), GraspPlanner()
    for line in sys.stdin:
        part_id, seed, seconds = line.split()
        part = catalogue.load(part_id)
        result = None
        for budget, most in ((60.0, 20), (float(seconds), None)):
            request = PlanRequest(
                time_budget_s=budget, max_evaluations=most, seed=int(seed), verification="none"
            )
            result = planner.answer(part, request).result
        best = sorted((grasp.epsilon for grasp in result.grasps), reverse=True)
        best += [0.0] * (20 - len(best))
        found = {"best": best[0], "mean": statistics.mean(best[:20]), "made": result.evaluations}
        print(json.dumps(found), flush=True)


def main() -> None:
    """Plan with both and print the means."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--former", default=FORMER, help="revision to compare with")
    parser.add_argument("--time", type=float, default=3.0, help="seconds of each plan")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--parts", nargs="+", help="IDs of shipped parts; default: all")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    os.environ["GPIS_GRASP_STORE"] = "off"
    if arguments.serve:
        serve()
        return
    from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory

    parts = arguments.parts or MeshCatalogue([default_catalogue_directory()]).ids()
    servers = {"now": Server(ROOT, __file__)}
    servers["former"] = Server(former_tree(arguments.former), __file__)
    found: dict[str, list[dict[str, float]]] = {"now": [], "former": []}
    print("| part | best, former | best, now | mean of 20, former | now | attempts, former | now |")
    print("|---|---|---|---|---|---|---|")
    turn = 0
    for part_id in parts:
        for seed in range(arguments.seeds):
            turn += 1
            for whose in ("now", "former") if turn % 2 else ("former", "now"):
                said = servers[whose].asked(f"{part_id} {seed} {arguments.time}")
                found[whose].append(json.loads(said))
        print(row(part_id, *(found[w][-arguments.seeds :] for w in ("former", "now"))), flush=True)
    print(row("all", found["former"], found["now"]))
    for server in servers.values():
        server.close()


def row(name: str, former: list[dict[str, float]], now: list[dict[str, float]]) -> str:
    """A row of the table: means over some plans."""
    cells = []
    for figure, digits in (("best", 4), ("mean", 4), ("made", 0)):
        for plans in (former, now):
            cells.append(f"{statistics.mean(one[figure] for one in plans):.{digits}f}")
    return f"| {name} | {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
