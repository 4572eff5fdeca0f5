"""Plan parts for 'plan-all' of another machine, through a Dask scheduler."""

from __future__ import annotations

import argparse
import json

from gpis_grasp_planner.cli import output
from gpis_grasp_planner.cli.exit_codes import SUCCESS

EXAMPLES = """\
examples:
  gpis-grasp worker tcp://10.0.0.1:8786
  gpis-grasp worker tcp://10.0.0.1:8786 --jobs 4
  gpis-grasp worker tcp://10.0.0.1:8786 --json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of 'worker'."""
    parser.add_argument("scheduler", metavar="ADDRESS", help="such as tcp://10.0.0.1:8786")
    parser.add_argument(
        "--jobs", type=int, metavar="N", help="parts at a time; default: one for each core"
    )
    parser.add_argument(
        "--json", action="store_true", help="print a line of JSON once the scheduler knows it"
    )


def run(arguments: argparse.Namespace) -> int:
    """Serve until Ctrl-C, SIGTERM or the end of the scheduler."""
    from gpis_grasp_planner.cli.preparation import ready_to_plan
    from gpis_grasp_planner.forked_child import jobs_asked_for
    from gpis_grasp_planner.plan.request import PlanRequest

    output.check_cluster()
    jobs = jobs_asked_for(arguments.jobs)
    ready_to_plan(PlanRequest().planner)
    from gpis_grasp_planner.batch.cluster import serve_worker

    def tell(worker: str) -> None:
        facts = {"worker": worker, "jobs": jobs, "scheduler": arguments.scheduler}
        if arguments.json:
            print(json.dumps(facts), flush=True)
        else:
            output.note(
                f"gpis-grasp: worker {worker} plans {jobs} at a time for {arguments.scheduler}"
            )

    serve_worker(arguments.scheduler, jobs, tell)
    return SUCCESS
